"""Closed solids the cases are made of, and faults of files that leave the solid as it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from manifold3d import Manifold, Mesh64
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, label
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


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


def _of_mesh(mesh: trimesh.Trimesh) -> Solid:
    return Solid(np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64))


def box(size: object) -> Solid:
    """Return a block with a corner at the origin."""
    sides = np.asarray(size, dtype=np.float64)
    return _of_mesh(trimesh.creation.box((1.0, 1.0, 1.0))).moved(0.5).scaled(sides)


def ball(radius: float, rings: int = 16) -> Solid:
    """Return a ball about the origin, with poles."""
    return _of_mesh(trimesh.creation.uv_sphere(radius, count=[rings, rings]))


def cylinder(radius: float, height: float, sides: int = 32) -> Solid:
    """Return a cylinder along z, standing on the origin."""
    made = trimesh.creation.cylinder(radius, height, sections=sides)
    return _of_mesh(made).moved((0.0, 0.0, height / 2))


def torus(radius: float, thick: float) -> Solid:
    """Return a ring about z."""
    return _of_mesh(trimesh.creation.torus(radius, thick, major_sections=32, minor_sections=16))


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
    """Return the group of each of ``count`` vertices, (count,): those that faces join."""
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [0, 2]]])
    joined_by = coo_matrix((np.ones(len(ends)), tuple(ends.T)), shape=(count, count))
    return np.asarray(connected_components(joined_by, directed=False)[1])


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
