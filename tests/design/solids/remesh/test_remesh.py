"""Remeshing: preserves shape and genus, produces the wanted triangles."""

from dataclasses import dataclass

import numpy as np
import pytest

from design.errors import SolidError
from design.solids.repair.remesh import LabelledSurface, remesh
from kernels.arrays import FloatArray, IntArray

CUBE = np.array(
    [
        [0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
        [2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5],
    ]
)  # fmt: skip
"""Faces, inward, of the cube whose corners are the binary numbers xyz."""


def cube_surface() -> LabelledSurface:
    """From -1 to 1, a label for each side: x, y and z low and high."""
    corner = 2.0 * np.array([[n >> 2 & 1, n >> 1 & 1, n & 1] for n in range(8)], float) - 1.0
    # All three of a side's corners have the same coordinate there.
    flat = np.array([np.ptp(corner[f], axis=0).argmin() for f in CUBE])
    high = np.array([corner[f[0], a] > 0.0 for f, a in zip(CUBE, flat, strict=True)])
    return LabelledSurface(corner, CUBE.astype(np.int64)[:, ::-1].copy(), 2 * flat + high)


def torus_surface(wide: float, thin: float, around: int = 9, across: int = 5) -> LabelledSurface:
    """A coarse grid on a torus."""
    u, v = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    angle, turn = 2.0 * np.pi * u / around, 2.0 * np.pi * v / across
    ring = wide + thin * np.cos(turn)
    points = np.stack([ring * np.cos(angle), ring * np.sin(angle), thin * np.sin(turn)], axis=-1)

    def at(i: IntArray, j: IntArray) -> IntArray:
        return (i % around) * across + j % across

    a, b, c, d = at(u, v), at(u + 1, v), at(u + 1, v + 1), at(u, v + 1)
    faces = np.concatenate(
        [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    )
    return LabelledSurface(points.reshape(-1, 3), faces, np.zeros(len(faces), np.int64))


@dataclass(frozen=True)
class Sphere:
    """Of radius 1; one edge length, or one that grows with z."""

    edge: float
    slope: float = 0.0

    def size(self, points: FloatArray) -> FloatArray:
        return np.maximum(self.edge * (1.0 + self.slope * points[:, 2]), 1e-3)

    def onto(self, points: FloatArray, patch: IntArray) -> FloatArray:
        return points / np.linalg.norm(points, axis=1)[:, None]


@dataclass(frozen=True)
class Torus:
    """Around z."""

    wide: float
    thin: float
    edge: float

    def size(self, points: FloatArray) -> FloatArray:
        return np.full(len(points), self.edge)

    def onto(self, points: FloatArray, patch: IntArray) -> FloatArray:
        ring = points * [1.0, 1.0, 0.0]
        ring *= self.wide / np.linalg.norm(ring, axis=1)[:, None]
        off = points - ring
        return ring + self.thin * off / np.linalg.norm(off, axis=1)[:, None]


@dataclass(frozen=True)
class Cube:
    """Its sides are where the rough one's are: points stay."""

    edge: float

    def size(self, points: FloatArray) -> FloatArray:
        return np.full(len(points), self.edge)

    def onto(self, points: FloatArray, patch: IntArray) -> FloatArray:
        return points


def euler(surface: LabelledSurface) -> int:
    """Vertices less edges plus faces."""
    ends = np.sort(surface.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return len(surface.vertices) - len(np.unique(ends, axis=0)) + len(surface.faces)


def areas(surface: LabelledSurface) -> FloatArray:
    """Of each face."""
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def volume(surface: LabelledSurface) -> float:
    """Enclosed, by the divergence theorem."""
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", np.cross(a, b), c) / 6.0)


def edges(surface: LabelledSurface) -> FloatArray:
    """Length of every side of every face, (f, 3)."""
    corner = surface.vertices[surface.faces]
    return np.linalg.norm(corner - corner[:, [1, 2, 0]], axis=2)


def qualities(surface: LabelledSurface) -> FloatArray:
    """4 √3 area over the sum of squared edges: 1 for an equilateral triangle."""
    return 4.0 * np.sqrt(3.0) * areas(surface) / (edges(surface) ** 2).sum(axis=1)


def _ball() -> LabelledSurface:
    rough = cube_surface()
    points = rough.vertices / np.sqrt(3.0)
    return LabelledSurface(points, rough.faces, np.zeros(12, np.int64))


def test_a_cube_becomes_an_even_sphere() -> None:
    found = remesh(_ball(), Sphere(0.2))
    assert euler(found) == 2
    assert qualities(found).min() > 0.6
    assert qualities(found).mean() > 0.95
    assert np.linalg.norm(found.vertices, axis=1) == pytest.approx(np.ones(len(found.vertices)))
    # Flat triangles of edge h on a unit sphere lack h²/8·(…) of its area and volume.
    assert areas(found).sum() == pytest.approx(4.0 * np.pi, rel=0.01)
    assert volume(found) == pytest.approx(4.0 * np.pi / 3.0, rel=0.02)
    assert 0.8 * 0.2 < edges(found).mean() < 1.2 * 0.2
    assert edges(found).max() < 1.6 * 0.2
    assert edges(found).min() > 0.5 * 0.2


def test_a_torus_stays_a_torus() -> None:
    wide, thin = 1.0, 0.3
    found = remesh(torus_surface(wide, thin), Torus(wide, thin, 0.1))
    assert euler(found) == 0
    assert qualities(found).min() > 0.5
    assert areas(found).sum() == pytest.approx(4.0 * np.pi**2 * wide * thin, rel=0.02)
    assert volume(found) == pytest.approx(2.0 * np.pi**2 * wide * thin**2, rel=0.04)


def test_rims_and_corners_stay_where_they_are() -> None:
    found = remesh(cube_surface(), Cube(0.3))
    assert euler(found) == 2
    assert volume(found) == pytest.approx(8.0, rel=1e-12)
    assert areas(found) @ (found.label == 3) == pytest.approx(4.0, rel=1e-12)
    for label in range(6):
        side = found.vertices[np.unique(found.faces[found.label == label])]
        assert side[:, label // 2] == pytest.approx(np.full(len(side), 2.0 * (label % 2) - 1.0))
    at_corner = (np.abs(np.abs(found.vertices) - 1.0) < 1e-12).all(axis=1)
    assert at_corner.sum() == 8
    assert qualities(found).min() > 0.4
    assert edges(found).max() < 1.7 * 0.3


def test_open_and_turned_surfaces_and_sizes_of_nothing_are_refused() -> None:
    rough = _ball()
    open_one = LabelledSurface(rough.vertices, rough.faces[1:], rough.label[1:])
    turned = LabelledSurface(
        rough.vertices, np.concatenate([rough.faces[:1, ::-1], rough.faces[1:]]), rough.label
    )
    doubled = LabelledSurface(
        rough.vertices, np.concatenate([rough.faces, rough.faces]), np.zeros(24, np.int64)
    )
    for bad in (open_one, turned, doubled):
        with pytest.raises(SolidError, match="isn't closed"):
            remesh(bad, Sphere(0.3))
    with pytest.raises(SolidError, match="wanted edge length"):
        remesh(rough, Sphere(float("nan")))
