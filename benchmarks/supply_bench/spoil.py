"""Faults of files that leave the solid as it is."""

from __future__ import annotations

import numpy as np

from benchmarks.supply_bench.judge import groups
from benchmarks.supply_bench.solids import Solid, joined

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
