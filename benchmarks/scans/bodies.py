"""Outer shapes of test parts: convex bodies bounded by planes, some also by a cylinder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import manifold3d
import numpy as np

NO_CYLINDER = (0.0, 0.0, 1e6)
FACETS = 256


@dataclass(frozen=True)
class Body:
    """A convex body in the part's frame.

    Attributes
    ----------
    size : (3,) float, mm
        Its bounding box begins at 0.
    planes : (n, 4) float
        Outward unit normals and offsets (mm): inside is ``normal @ p <= offset``.
    cylinder : (float, float, float), mm
        Axis' x and y and radius of a cylinder along z; a radius of 1e6 is none.
    """

    size: np.ndarray
    planes: np.ndarray
    cylinder: tuple[float, float, float] = NO_CYLINDER

    @property
    def is_round(self) -> bool:
        """Whether a cylinder bounds it."""
        return self.cylinder[2] < 1e5

    def depth(self, points: np.ndarray) -> np.ndarray:
        """Distance of points (n, 3) outwards beyond the surface, mm; negative inside."""
        flat = (points @ self.planes[:, :3].T - self.planes[:, 3]).max(axis=1)
        x, y, radius = self.cylinder
        return np.asarray(np.maximum(flat, np.hypot(points[:, 0] - x, points[:, 1] - y) - radius))

    def solid(self) -> Any:
        """The body as a manifold."""
        if self.is_round:
            x, y, radius = self.cylinder
            whole = manifold3d.Manifold.cylinder(self.size[2], radius, radius, FACETS)
            whole = whole.translate((x, y, 0.0))
        else:
            whole = manifold3d.Manifold.cube(self.size)
        for *normal, offset in self.planes:
            whole = whole.trim_by_plane([-v for v in normal], -offset)
        return whole


def box_planes(size: np.ndarray) -> np.ndarray:
    """Return the six planes of a box from 0 to `size` (mm)."""
    rows = []
    for axis in range(3):
        normal = np.eye(3)[axis]
        rows += [[*normal, size[axis]], [*-normal, 0.0]]
    return np.array(rows)


def block(x: float, y: float, z: float) -> Body:
    """Return a box."""
    size = np.array([x, y, z])
    return Body(size, box_planes(size))


def cylinder(diameter: float, height: float) -> Body:
    """Return a cylinder that stands on its end."""
    size = np.array([diameter, diameter, height])
    return Body(size, box_planes(size)[4:], (diameter / 2, diameter / 2, diameter / 2))


def wedge(x: float, y: float, z: float, drop: float = 0.25, chamfer: float = 1.2) -> Body:
    """Return a box whose top falls by `drop` of its height along x, one upright edge chamfered."""
    size = np.array([x, y, z])
    top = np.array([drop * z / x, 0.0, 1.0])
    top /= np.linalg.norm(top)
    edge = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
    corner = np.array([x, y, 0.0])
    extra = [[*top, top @ [0, 0, z]], [*edge, edge @ corner - chamfer / np.sqrt(2)]]
    return Body(size, np.vstack([box_planes(size), extra]))
