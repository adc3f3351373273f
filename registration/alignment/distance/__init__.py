"""Exact signed distances to a triangle surface, and a grid of them.

Goes in: a triangle surface and points. Comes out: signed distances, mm. Begin with `surface.py`.
"""

from registration.alignment.distance.grid import DistanceGrid, distance_grid
from registration.alignment.distance.surface import ModelSurface, Nearest

__all__ = ["DistanceGrid", "ModelSurface", "Nearest", "distance_grid"]
