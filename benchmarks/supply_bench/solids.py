"""Closed solids in plain NumPy, and drilled ones by manifold3d: what the cases are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from manifold3d import Manifold, Mesh64
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
_CUBE = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


@dataclass(frozen=True)
class Solid:
    """A closed surface seen from outside: ``points`` (n, 3), mm, and ``faces`` (m, 3)."""

    points: FloatArray
    faces: IntArray

    def moved(self, by: object) -> Solid:
        """The same elsewhere."""
        return Solid(self.points + np.asarray(by, dtype=np.float64), self.faces)

    def turned(self, frame: FloatArray) -> Solid:
        """The same, rotated by ``frame`` (3, 3)."""
        return Solid(self.points @ frame.T, self.faces)

    def scaled(self, by: object) -> Solid:
        """The same, stretched along the axes."""
        return Solid(self.points * np.asarray(by, dtype=np.float64), self.faces)

    @property
    def inverted(self) -> Solid:
        """The same, seen from inside."""
        return Solid(self.points, self.faces[:, ::-1].copy())


def joined(*solids: Solid) -> Solid:
    """Several solids in one list of faces, nothing merged."""
    first = np.cumsum([0, *(len(one.points) for one in solids)])
    return Solid(
        np.concatenate([one.points for one in solids]),
        np.concatenate([one.faces + k for one, k in zip(solids, first, strict=False)]),
    )


def box(size: object) -> Solid:
    """A block with a corner at the origin."""
    corners = np.array(list(np.ndindex(2, 2, 2)), dtype=np.float64)
    quads = np.array(_CUBE)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return Solid(corners * np.asarray(size, dtype=np.float64), faces)


def grid_tube(rings: FloatArray, closed: bool) -> Solid:
    """Rings (r, k, 3) of points joined to a tube; ``closed`` on itself, or capped by fans."""
    many, across = rings.shape[:2]
    number = np.arange(many * across).reshape(many, across)
    last = many if closed else many - 1
    faces = []
    for i in range(last):
        a, b = number[i], number[(i + 1) % many]
        c, d = np.roll(a, -1), np.roll(b, -1)
        faces += [np.stack([a, c, b], axis=1), np.stack([c, d, b], axis=1)]
    points = rings.reshape(-1, 3)
    if not closed:
        ends = np.stack([rings[0].mean(axis=0), rings[-1].mean(axis=0)])
        low, high = number[0], number[-1]
        at = len(points)
        faces.append(np.stack([np.roll(low, -1), low, np.full(across, at)], axis=1))
        faces.append(np.stack([high, np.roll(high, -1), np.full(across, at + 1)], axis=1))
        points = np.concatenate([points, ends])
    return _outward(Solid(points, np.concatenate(faces)))


def _outward(solid: Solid) -> Solid:
    return solid if volume_of(solid) > 0 else solid.inverted


def ball(radius: float, rings: int = 16) -> Solid:
    """A ball about the origin, with poles."""
    polar = np.linspace(0, np.pi, rings + 1)[1:-1]
    around = np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)
    p, a = np.meshgrid(polar, around, indexing="ij")
    at = radius * np.stack([np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)], axis=2)
    made = grid_tube(at, closed=False)
    made.points[-2:] = [[0, 0, radius], [0, 0, -radius]]
    return made


def cylinder(radius: float, height: float, sides: int = 32) -> Solid:
    """A cylinder along z, standing on the origin."""
    turn = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    ring = np.stack([radius * np.cos(turn), radius * np.sin(turn), 0 * turn], axis=1)
    return grid_tube(np.stack([ring, ring + [0, 0, height]]), closed=False)


def torus(radius: float, thick: float, sides: int = 32) -> Solid:
    """A ring about z."""
    turn = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    u, v = np.meshgrid(turn, turn[:: max(1, sides // 16)], indexing="ij")
    away = radius + thick * np.cos(v)
    rings = np.stack([away * np.cos(u), away * np.sin(u), thick * np.sin(v)], axis=2)
    return grid_tube(rings, closed=True)


def random_frame(rng: np.random.Generator) -> FloatArray:
    """A random rotation."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def volume_of(solid: Solid) -> float:
    """Enclosed volume by the divergence theorem, mm³."""
    a, b, c = np.moveaxis(solid.points[solid.faces] - solid.points.mean(axis=0), 1, 0)
    return float((a * np.cross(b, c)).sum() / 6.0)


def manifold(solid: Solid) -> Manifold:
    """For booleans."""
    return Manifold(Mesh64(solid.points, solid.faces.astype(np.uint64)))


def of_manifold(made: Manifold) -> Solid:
    """The result of booleans."""
    mesh = made.to_mesh64()
    points = np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3]
    return Solid(points, np.asarray(mesh.tri_verts).astype(np.int64))
