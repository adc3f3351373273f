"""Test parts with slanted, bent or branching lumens or thin walls; built with manifold3d alone."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import manifold3d as m3
import numpy as np
from numpy.typing import NDArray

from benchmarks.checkers.bead_lumens import Axis

FloatArray = NDArray[np.float64]
SIDES = 72


@dataclass(frozen=True)
class BentPart:
    """A mesh, and the axes of its lumens.

    Attributes
    ----------
    name : str
    body : manifold3d.Manifold
    axes : tuple of Axis
    paths : tuple of (name, (n, 3) float64 in mm, radius in mm)
        Whole lumens that `printctl lumens` is held against.
    """

    name: str
    body: m3.Manifold
    axes: tuple[Axis, ...]
    paths: tuple[tuple[str, FloatArray, float], ...] = ()

    @property
    def middle(self) -> FloatArray:
        """Middle of its bounds in x and y, and its lowest z, mm."""
        low, high = np.array(self.body.bounding_box()).reshape(2, 3)
        return np.array([*(low + high)[:2] / 2, low[2]])

    def write_stl(self, path: Path) -> None:
        """Binary STL."""
        mesh = self.body.to_mesh()
        corner = np.asarray(mesh.vert_properties[:, :3], np.float32)[np.asarray(mesh.tri_verts)]
        rows = np.zeros(len(corner), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
        rows["v"] = corner
        path.write_bytes(b"\0" * 80 + struct.pack("<I", len(corner)) + rows.tobytes())


def tube(path: FloatArray, radius: float) -> m3.Manifold:
    """A round tube along points (n, 3)."""
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    one = np.cross(along[0], [0.0, 0, 1] if abs(along[0, 2]) < 0.9 else [1.0, 0, 0])
    turn = np.arange(SIDES) / SIDES * 2 * np.pi
    rings = []
    for point, way in zip(path, along, strict=True):
        one = one - way * (one @ way)
        one /= np.linalg.norm(one)
        two = np.cross(way, one)
        rings.append(point + radius * (np.cos(turn)[:, None] * one + np.sin(turn)[:, None] * two))
    vertex = np.concatenate([*rings, path[:1], path[-1:]]).astype(np.float32)
    n, faces = len(path), []
    for k in range(n - 1):
        for s in range(SIDES):
            a, b = k * SIDES + s, k * SIDES + (s + 1) % SIDES
            faces += [[a, b, b + SIDES], [a, b + SIDES, a + SIDES]]
    for s in range(SIDES):
        faces.append([n * SIDES, (s + 1) % SIDES, s])
        faces.append([n * SIDES + 1, (n - 1) * SIDES + s, (n - 1) * SIDES + (s + 1) % SIDES])
    return m3.Manifold(m3.Mesh(vertex, np.array(faces, np.uint32)))


def axis(name: str, path: FloatArray, radius: float, count: int = 9, ends: float = 0.25) -> Axis:
    """Evenly spaced points of the middle of a path."""
    step = np.linalg.norm(np.diff(path, axis=0), axis=1)
    at = np.concatenate([[0.0], np.cumsum(step)])
    where = np.linspace(ends, 1 - ends, count) * at[-1]
    point = np.column_stack([np.interp(where, at, column) for column in path.T])
    after = np.column_stack([np.interp(where + 1e-3, at, column) for column in path.T])
    before = np.column_stack([np.interp(where - 1e-3, at, column) for column in path.T])
    along = after - before
    along /= np.linalg.norm(along, axis=1)[:, None]
    return Axis(name, point, along, np.full(count, 2 * radius))


def slanted() -> BentPart:
    """Straight lumens 0 to 80 degrees off the upright, arcs and helices, in a block."""
    lanes, paths = [], []
    for k, tilt in enumerate(np.linspace(0, 80, 17)):
        turn, radius = np.radians(37.0 * k), (0.2, 0.275, 0.35, 0.45)[k % 4]
        lean = np.radians(tilt)
        way = np.array([np.sin(lean) * np.cos(turn), np.sin(lean) * np.sin(turn), np.cos(lean)])
        length = min(4.0 / max(np.cos(lean), 0.2), 3.2)
        middle = np.array([2.4 * (k % 5), 2.4 * (k // 5), 1.8])
        path = middle + np.linspace(-0.5, 0.5, 3)[:, None] * length * way
        paths.append((f"{tilt:.0f} deg", path, radius))
    for k in range(3):
        turn = np.linspace(0.15, np.pi - 0.15, 40)
        middle = np.array([2.4 * (2 + k), 2.4 * 3, 0.7])
        side = np.array([np.cos(1.1 * k), np.sin(1.1 * k)])
        reach = 0.9
        path = np.column_stack([np.cos(turn)[:, None] * reach * side, reach * np.sin(turn) * 2])
        paths.append((f"arc {k}", path + middle, 0.25 + 0.05 * k))
    for k in range(3):
        turn = np.linspace(0, 2 * np.pi * 1.5, 90)
        middle = np.array([2.4 * k + 1, 2.4 * 4.1, 0.3])
        path = np.column_stack([0.6 * np.cos(turn), 0.6 * np.sin(turn), 0.32 * turn])
        paths.append((f"helix {k}", path + middle, 0.2 + 0.05 * k))
    body = m3.Manifold.cube([14.5, 14.5, 3.6]).translate([-2.4, -2.4, 0])
    for name, path, radius in paths:
        body -= tube(path, radius)
        lanes.append(axis(name, path, radius))
    return BentPart("slanted", body, tuple(lanes), tuple(paths))


def bifurcations(wall: float = 0.4) -> BentPart:
    """Four forks of thin wall, of different angles."""
    inner, outer, axes = [], [], []
    for k, half in enumerate((20, 35, 50, 65)):
        base = np.array([4.5 * k, 0.0, 0.0])
        fork = base + [0, 0, 2.0]
        trunk = np.array([base - [0, 0, 0.5], fork])
        pieces = [("trunk", trunk, 0.5)]
        for sign, turn in ((1, 0.3), (-1, 0.3)):
            lean = np.radians(half)
            way = np.array(
                [
                    sign * np.sin(lean) * np.cos(turn),
                    sign * np.sin(lean) * np.sin(turn),
                    np.cos(lean),
                ]
            )
            path = fork + np.linspace(0, 2.2 / np.cos(lean) ** 0.5, 8)[:, None] * way
            path[:, 2] += 0.15 * np.linspace(0, 1, 8) ** 2
            pieces.append((f"branch {half}", path, 0.38))
        for name, path, radius in pieces:
            inner.append(tube(path, radius))
            shell = path.copy()
            outer.append(tube(shell, radius + wall))
            low = 0.15 if name == "trunk" else 0.62
            axes.append(_part(axis(f"{k} {name}", path, radius, 24, 0.02), low, 0.85))
        inner.append(m3.Manifold.sphere(0.5, SIDES).translate(fork.tolist()))
        outer.append(m3.Manifold.sphere(0.5 + wall, SIDES).translate(fork.tolist()))
    low = m3.Manifold.cube([40, 40, 5.0]).translate([-10, -20, 0.0])
    body = (m3.Manifold.batch_boolean(outer, m3.OpType.Add)) ^ low
    return BentPart(
        "bifurcations", body - m3.Manifold.batch_boolean(inner, m3.OpType.Add), tuple(axes)
    )


def _part(one: Axis, low: float, high: float) -> Axis:
    n = len(one.point)
    rows = slice(int(low * n), int(high * n))
    return Axis(one.name, one.point[rows], one.along[rows], one.diameter[rows])


def ventricle(wall: float = 0.45) -> BentPart:
    """The lower half of a thin shell."""
    outer = m3.Manifold.sphere(1, 128).scale([2.6 + wall, 2.1 + wall, 3.6 + wall])
    inner = m3.Manifold.sphere(1, 128).scale([2.6, 2.1, 3.6])
    lower = m3.Manifold.cube([10, 10, 3.4]).translate([-5, -5, -3.4])
    body = (outer - inner) ^ lower
    return BentPart("ventricle", body, ())


def gyroid(period: float = 2.4, thick: float = 0.35) -> BentPart:
    """A sheet of the gyroid's surface, two periods wide."""
    k = 2 * np.pi / period
    scale = thick / 2 * k * 1.45

    def field(x: float, y: float, z: float) -> float:
        a, b, c = k * x, k * y, k * z
        f = np.sin(a) * np.cos(b) + np.sin(b) * np.cos(c) + np.sin(c) * np.cos(a)
        box = min(x, y, z, 2 * period - x, 2 * period - y, 1.2 * period - z)
        return float(min(scale - abs(f), box * 4))

    size = [-0.1, -0.1, -0.1, 2 * period + 0.1, 2 * period + 0.1, 1.2 * period + 0.1]
    body = m3.Manifold.level_set(field, size, 0.08)
    body = max(body.decompose(), key=lambda piece: piece.volume())
    return BentPart("gyroid", body, ())
