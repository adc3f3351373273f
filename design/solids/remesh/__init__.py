"""Remesh surfaces with even, nearly equilateral triangles.

Goes in: a closed surface and wanted edge lengths. Comes out: the same surface of even triangles.
Begin with `remesh.py`.
"""

from design.solids.remesh.remesh import LabelledSurface, Shape, patches, remesh

__all__ = ["LabelledSurface", "Shape", "patches", "remesh"]
