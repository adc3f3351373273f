"""Closed solids the cases are made of, and faults of files that leave the solid as it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from manifold3d import Manifold, Mesh64
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, label

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


def groups(count: int, faces: IntArray) -> IntArray:
    """Number of the group of each of ``count`` vertices: joined by faces, by union and find."""
    above = list(range(count))

    def find(k: int) -> int:
        while above[k] != k:
            above[k] = above[above[k]]
            k = above[k]
        return k

    for a, b, c in faces.tolist():
        one = find(a)
        above[find(b)] = one
        above[find(c)] = one
    return np.unique([find(k) for k in range(count)], return_inverse=True)[1]


Rng = np.random.Generator


def flat_faces(solid: Solid, rng: Rng, count: int) -> Solid:
    """A vertex on some edges, with a face without area between; needles and repeated corners."""
    points, faces = solid.points.tolist(), solid.faces.tolist()
    for k in rng.choice(len(faces), min(count, len(faces)), replace=False).tolist():
        a, b, c = faces[k]
        points.append(np.mean([points[a], points[b]], axis=0).tolist())
        middle = len(points) - 1
        faces[k] = [a, middle, c]
        faces += [[middle, b, c], [a, b, middle]]
    faces += [[a, a, b] for a, b, _ in solid.faces[:2].tolist()]
    return Solid(np.array(points), np.array(faces))


def doubled_faces(solid: Solid, rng: Rng, count: int) -> Solid:
    """Some faces twice or three times, with other corners first."""
    some = solid.faces[rng.choice(len(solid.faces), min(count, len(solid.faces)), replace=False)]
    again = np.roll(some, 1, axis=1)
    return Solid(solid.points, np.concatenate([solid.faces, again, some[: len(some) // 2]]))


def stray_sheets(solid: Solid, rng: Rng, count: int) -> Solid:
    """Single triangles and a bent sheet, clear of the solid or within it."""
    low, high = solid.points.min(axis=0), solid.points.max(axis=0)
    made = [solid]
    for _ in range(min(count, 5)):
        at = high + rng.uniform(0.5, 3, 3) if rng.random() < 0.6 else (low + high) / 2
        corners = at + rng.uniform(-0.3, 0.3, (3, 3))
        made.append(Solid(corners, np.array([[0, 1, 2]])))
    x, y = np.meshgrid(np.linspace(0, 4, 5), np.linspace(0, 4, 5), indexing="ij")
    sheet = np.stack([x, y, 0.3 * np.sin(x)], axis=2).reshape(-1, 3) + high + 1.0
    n = np.arange(25).reshape(5, 5)
    a, b, c, d = (n[:-1, :-1], n[1:, :-1], n[1:, 1:], n[:-1, 1:])
    faces = [np.stack(t, axis=2).reshape(-1, 3) for t in ([a, b, c], [a, c, d])]
    return joined(*made, Solid(sheet, np.concatenate(faces)))


def missing_joints(solid: Solid, rng: Rng, count: int) -> Solid:
    """A vertex on an edge that the face on its one side has and that on its other hasn't."""
    points, faces = solid.points.tolist(), solid.faces.tolist()
    for k in rng.choice(len(faces), min(count, len(faces)), replace=False).tolist():
        a, b, c = faces[k]
        points.append((0.4 * np.array(points[a]) + 0.6 * np.array(points[b])).tolist())
        faces[k] = [a, len(points) - 1, c]
        faces.append([len(points) - 1, b, c])
    return Solid(np.array(points), np.array(faces))


def turned_faces(solid: Solid, rng: Rng, count: int) -> Solid:
    """Up to a tenth of the faces, the wrong way round."""
    faces = solid.faces.copy()
    some = rng.choice(len(faces), max(1, min(count, len(faces) // 10)), replace=False)
    faces[some] = faces[some, ::-1]
    return Solid(solid.points, faces)


def turned_shells(solid: Solid, rng: Rng, count: int) -> Solid:
    """The whole file inside out, or one of its shells."""
    faces = solid.faces.copy()
    group = groups(len(solid.points), faces)[faces[:, 0]]
    turned = group == rng.choice(group) if rng.random() < 0.5 else np.ones(len(faces), bool)
    faces[turned] = faces[turned, ::-1]
    return Solid(solid.points, faces)


def parted_vertices(solid: Solid, rng: Rng, count: int) -> Solid:
    """Every face with corners of its own, some a few nanometres away."""
    points = solid.points[solid.faces.ravel()]
    points = points + rng.choice([0, 0, 0, 2e-6], (len(points), 3)) * rng.uniform(-1, 1, (1, 3))
    return Solid(points, np.arange(len(points)).reshape(-1, 3))


_SIDES = [
    ((1, 0, 0), [(1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0, 1)]),
    ((-1, 0, 0), [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0)]),
    ((0, 1, 0), [(0, 1, 0), (0, 1, 1), (1, 1, 1), (1, 1, 0)]),
    ((0, -1, 0), [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)]),
    ((0, 0, 1), [(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]),
    ((0, 0, -1), [(0, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 0)]),
]


def blobs(rng: np.random.Generator) -> tuple[Solid, list[Solid]]:
    """The surface of random voxels of 2 mm, and each part's; parts meet in edges and corners.

    Parts of fewer than six voxels are left out.
    """
    size = int(rng.integers(6, 10))
    field = gaussian_filter(rng.normal(size=(size,) * 3), 1.0)
    field /= field.std()
    full = np.pad(field > rng.uniform(0.2, 0.8), 1)
    number, count = label(full)
    for n in range(1, count + 1):
        if (number == n).sum() < 6:
            number[number == n] = 0
    number, count = label(number > 0)
    parts = [_surface(number == n + 1, 2.0) for n in range(count)]
    return _surface(number > 0, 2.0), sorted(parts, key=volume_of, reverse=True)


def _surface(full: np.ndarray, pitch: float) -> Solid:
    """Two triangles for each side of a voxel that has none beside it."""
    corners = []
    for way, quad in _SIDES:
        beside = np.roll(full, [-w for w in way], axis=(0, 1, 2))
        at = np.argwhere(full & ~beside)
        for order in ((0, 1, 2), (0, 2, 3)):
            corners.append(at[:, None] + np.array([quad[k] for k in order])[None])
    flat = np.concatenate(corners).reshape(-1, 3)
    points, faces = np.unique(flat, axis=0, return_inverse=True)
    return Solid(pitch * points.astype(np.float64), faces.reshape(-1, 3))
