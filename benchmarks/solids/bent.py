"""Slanted, bent or branching lumens and thin walls, sliced beside PrusaSlicer.

PrusaSlicer's third settings, "precise", are classic walls without any simplification of outlines.
Parts are built with manifold3d alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import manifold3d as m3
import numpy as np
import shapely
from numpy.typing import NDArray

from benchmarks.checkers.lumens import Axis, bare_percent, free_diameters
from benchmarks.checkers.meshes import write_stl
from benchmarks.common import Row, row, scratch
from benchmarks.scans.designs import sweep
from benchmarks.solids.slicing import (
    LAYER_MM,
    STEPS_PER_MM,
    WALLS,
    Written,
    slice_ours,
    slice_peers,
)

FloatArray = NDArray[np.float64]
SIDES = 72
PRECISE = ["--resolution", "0", "--gcode-resolution", "0.001", "--slice-closing-radius", "0.001"]
PEERS = WALLS | {"precise": WALLS["classic"] + PRECISE}


@dataclass(frozen=True)
class BentPart:
    """A solid, and the axes of its lumens."""

    name: str
    body: m3.Manifold
    axes: tuple[Axis, ...]

    @property
    def middle(self) -> FloatArray:
        """Middle of its bounds in x and y, and its lowest z, mm."""
        low, high = np.array(self.body.bounding_box()).reshape(2, 3)
        return np.array([*(low + high)[:2] / 2, low[2]])

    def write_stl(self, path: Path) -> None:
        """Write a binary STL."""
        mesh = self.body.to_mesh()
        corner = np.asarray(mesh.vert_properties[:, :3], np.float32)[np.asarray(mesh.tri_verts)]
        write_stl(path, corner)


def tube(path: FloatArray, radius: float) -> m3.Manifold:
    """Return a round tube along points (n, 3)."""
    return sweep(path, np.full(len(path), radius), SIDES)


def axis(
    name: str,
    path: FloatArray,
    radius: float,
    count: int = 9,
    ends: float = 0.25,
    rows: slice = slice(None),
) -> Axis:
    """Return some of ``count`` evenly spaced points of a path, less its ``ends``."""
    step = np.linalg.norm(np.diff(path, axis=0), axis=1)
    at = np.concatenate([[0.0], np.cumsum(step)])
    where = np.linspace(ends, 1 - ends, count)[rows] * at[-1]
    point = np.column_stack([np.interp(where, at, column) for column in path.T])
    after = np.column_stack([np.interp(where + 1e-3, at, column) for column in path.T])
    before = np.column_stack([np.interp(where - 1e-3, at, column) for column in path.T])
    along = after - before
    along /= np.linalg.norm(along, axis=1)[:, None]
    return Axis(name, point, along, np.full(len(point), 2 * radius))


def slanted() -> BentPart:
    """Return straight lumens 0 to 80 degrees off the upright, arcs and helices, in a block."""
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
    return BentPart("slanted", body, tuple(lanes))


def bifurcations(wall: float = 0.4) -> BentPart:
    """Return four forks of thin wall, of different angles."""
    inner, outer, axes = [], [], []
    for k, half in enumerate((20, 35, 50, 65)):
        base = np.array([4.5 * k, 0.0, 0.0])
        fork = base + [0, 0, 2.0]
        trunk = np.array([base - [0, 0, 0.5], fork])
        pieces = [("trunk", trunk, 0.5)]
        for sign, turn in ((1, 0.3), (-1, 0.3)):
            lean = np.radians(half)
            aside = sign * np.sin(lean)
            way = np.array([aside * np.cos(turn), aside * np.sin(turn), np.cos(lean)])
            path = fork + np.linspace(0, 2.2 / np.cos(lean) ** 0.5, 8)[:, None] * way
            path[:, 2] += 0.15 * np.linspace(0, 1, 8) ** 2
            pieces.append((f"branch {half}", path, 0.38))
        for name, path, radius in pieces:
            inner.append(tube(path, radius))
            outer.append(tube(path, radius + wall))
            measured = slice(3 if name == "trunk" else 14, 20)
            axes.append(axis(f"{k} {name}", path, radius, 24, 0.02, measured))
        inner.append(m3.Manifold.sphere(0.5, SIDES).translate(fork.tolist()))
        outer.append(m3.Manifold.sphere(0.5 + wall, SIDES).translate(fork.tolist()))
    low = m3.Manifold.cube([40, 40, 5.0]).translate([-10, -20, 0.0])
    body = (m3.Manifold.batch_boolean(outer, m3.OpType.Add)) ^ low
    body -= m3.Manifold.batch_boolean(inner, m3.OpType.Add)
    return BentPart("bifurcations", body, tuple(axes))


def ventricle(wall: float = 0.45) -> BentPart:
    """Return the lower half of a thin shell."""
    outer = m3.Manifold.sphere(1, 128).scale([2.6 + wall, 2.1 + wall, 3.6 + wall])
    inner = m3.Manifold.sphere(1, 128).scale([2.6, 2.1, 3.6])
    lower = m3.Manifold.cube([10, 10, 3.4]).translate([-5, -5, -3.4])
    body = (outer - inner) ^ lower
    return BentPart("ventricle", body, ())


def gyroid(period: float = 2.4, thick: float = 0.35) -> BentPart:
    """Return a sheet of the gyroid's surface, two periods wide."""
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


def rows(quick: bool) -> Iterator[Row]:
    """Yield all parts; quick has the slanted lumens alone."""
    for make in (slanted,) if quick else (slanted, bifurcations, ventricle, gyroid):
        part = make()
        with scratch() as folder:
            model = folder / f"{part.name}.stl"
            part.write_stl(model)
            made = slice_ours(model, part.middle)
            peers = slice_peers(model, part.middle, PEERS)
        if part.axes:
            yield from _axis_rows(part, made, peers)
        peer = {name: _bare(part, one) for name, one in peers.items()}
        bare = _bare(part, made)
        yield row(f"{part.name}: uncovered material", bare, "%", "<= 0.5", bare <= 0.5, peer)
        least = min((one.cpu_s for one in peers.values()), default=None)
        more = {} if least is None else {"over_prusaslicer": made.cpu_s / least}
        yield row(f"{part.name}: CPU of the whole process", made.cpu_s, "s") | more


def _axis_rows(part: BentPart, made: Written, peers: dict[str, Written]) -> Iterator[Row]:
    for steps, goal in ((False, 5.0), (True, 10.0)):
        found = {name: _loss_um(part, one, steps) for name, one in peers.items()}
        own = _loss_um(part, made, steps)
        how = f"after {STEPS_PER_MM:g} steps/mm" if steps else "as written"
        for what, percent, limit in (("median", 50, goal), ("95 %", 95, 12.0)):
            peer = {name: float(np.percentile(value, percent)) for name, value in found.items()}
            measure = f"{part.name}: lumens' loss of the widest free circle, {what}, {how}"
            value = float(np.percentile(own, percent))
            met = value <= min([limit, *peer.values()])
            yield row(measure, value, "um", f"<= {limit:g}, and all settings'", met, peer)


def _loss_um(part: BentPart, written: Written, steps: bool) -> FloatArray:
    """Return designed diameter less the widest free circle's, median along each lumen."""
    lines, found = written.lines(steps=steps, own=True), []
    for one in part.axes:
        moved = Axis(one.name, one.point + written.place, one.along, one.diameter)
        free = free_diameters(lines, LAYER_MM, moved)
        found.append(1e3 * float(np.median(one.diameter - free)))
    return np.array(found)


def _bare(part: BentPart, written: Written) -> float:
    def material(z: float) -> shapely.Geometry:
        found = shapely.Polygon()
        for ring in part.body.slice(z - LAYER_MM / 2 - written.place[2]).to_polygons():
            if len(ring) > 2:
                found = shapely.symmetric_difference(found, shapely.Polygon(ring).buffer(0))
        return shapely.transform(found, lambda points: points + written.place[:2])

    return bare_percent(written.lines(steps=False, own=True), material)
