"""Count channels through a part that don't appear as holes in its horizontal sections."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from shapely.geometry.base import BaseGeometry

LEAST_AREA_MM2: Final = 1e-4
"""Of a region of a section, or of two sections' overlap, that counts."""


def unfollowed_ways(sections: Sequence[Sequence[NDArray[np.float64]]]) -> int:
    """Handles that are left in a part once every hole of its sections is filled.

    A lumen that lies level and is open at both ends parts the sections instead of leaving a hole in
    them. The part is taken as a stack of slabs, each the section filled; by its Euler
    characteristic, regions less overlaps of neighbouring sections, it has ``pieces - χ`` handles.

    Parameters
    ----------
    sections : sequence of sequences of (n, 2) float64, mm
        Rings of each section from the lowest up: outlines anticlockwise, holes clockwise.
    """
    layers = [_regions(rings) for rings in sections]
    first = np.cumsum([0, *(len(regions) for regions in layers)])
    pairs, overlaps, rings = [], 0, 0
    for k, (lower, upper) in enumerate(pairwise(layers)):
        over, under = shapely.STRtree(lower).query(upper, predicate="intersects")
        met = shapely.intersection(np.array(upper)[over], np.array(lower)[under])
        for above, below, shape in zip(over.tolist(), under.tolist(), met, strict=True):
            parts = _wide(shape)
            overlaps += len(parts)
            rings += sum(len(part.interiors) for part in parts)
            if parts:
                pairs.append((first[k] + below, first[k + 1] + above))
    count = int(first[-1])
    ends = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    graph = coo_matrix((np.ones(len(ends)), ends.T), shape=(count, count))
    pieces = connected_components(graph, directed=False)[0] if count else 0
    return max(0, pieces - (count - (overlaps - rings)))


def _regions(rings: Sequence[NDArray[np.float64]]) -> list[BaseGeometry]:
    """The outer regions of a section, holes filled; what stands within a hole is in them."""
    filled = [shapely.Polygon(ring) for ring in rings if signed_area(ring) > LEAST_AREA_MM2]
    return _wide(shapely.union_all(shapely.make_valid(np.array(filled)))) if filled else []


def _wide(shape: BaseGeometry) -> list[BaseGeometry]:
    parts = shapely.get_parts(shape)
    polygons = parts[shapely.get_type_id(parts) == shapely.GeometryType.POLYGON]
    return list(polygons[shapely.area(polygons) > LEAST_AREA_MM2])


def signed_area(corner: NDArray[np.float64]) -> float:
    """Area within a ring (n, 2), negative where it runs clockwise."""
    x, y = corner.T
    return float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2
