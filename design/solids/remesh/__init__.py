"""Remesh surfaces with even, nearly equilateral triangles."""

from design.solids.remesh.remesh import LabelledSurface, Shape, patches, remesh

__all__ = ["LabelledSurface", "Shape", "patches", "remesh"]
