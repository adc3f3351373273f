"""Distances, nearest points and intersections of points, segments and triangle surfaces.

Names are loaded when first used: a process that only names a surface needs no kernels.

Goes in: points, segments and triangles, mm. Comes out: distances, nearest points, intersections.
Begin with `bvh.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from design.geometry.bvh import (
        TriangleTree,
        boxes_of,
        build_hierarchy,
        build_triangle_tree,
        gather_within,
        nearest_distance,
        nearest_distances,
    )
    from design.geometry.segments import point_segment, point_triangle_squared, segment_segment

__all__ = [
    "TriangleTree",
    "boxes_of",
    "build_hierarchy",
    "build_triangle_tree",
    "gather_within",
    "nearest_distance",
    "nearest_distances",
    "point_segment",
    "point_triangle_squared",
    "segment_segment",
]

__getattr__, __dir__ = on_demand(__name__)
