"""Slanted, bent or branching lumens and thin walls, sliced beside PrusaSlicer.

PrusaSlicer's third settings, "precise", are classic walls without any simplification of outlines.
Parts are built with manifold3d alone.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import manifold3d as m3
import numpy as np
import shapely
from numpy.typing import NDArray

from benchmarks.checkers.lumens import Axis, compare_layers, free_sections
from benchmarks.checkers.meshes import write_stl
from benchmarks.checkers.read_gcode import Lines, Moves, own_lines, read_moves, rounded_to_steps
from benchmarks.common import Row, printctl, row, timed
from benchmarks.solids.slicing import PRUSA_INI

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
    """

    name: str
    body: m3.Manifold
    axes: tuple[Axis, ...]

    @property
    def middle(self) -> FloatArray:
        """Middle of its bounds in x and y, and its lowest z, mm."""
        low, high = np.array(self.body.bounding_box()).reshape(2, 3)
        return np.array([*(low + high)[:2] / 2, low[2]])

    def write_stl(self, path: Path) -> None:
        """Binary STL."""
        mesh = self.body.to_mesh()
        corner = np.asarray(mesh.vert_properties[:, :3], np.float32)[np.asarray(mesh.tri_verts)]
        write_stl(path, corner)


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
    return BentPart("slanted", body, tuple(lanes))


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


LAYER_MM, STEPS_PER_MM, SYRINGE_MM, FILAMENT_MM = 0.06, 80.0, 4.61, 1.75
PEERS = {
    "arachne": ["--perimeter-generator", "arachne"],
    "classic": ["--perimeter-generator", "classic"],
    "precise": [
        "--perimeter-generator", "classic", "--resolution", "0", "--gcode-resolution", "0.001",
        "--slice-closing-radius", "0.001",
    ],
}  # fmt: skip


@dataclass(frozen=True)
class Written:
    """A file, its moves, what a millimetre of E is, the part's origin in its frame, CPU s."""

    file: Path
    moves: Moves
    ul_per_e: float
    place: NDArray[np.float64]
    cpu_s: float

    def lines(self, *, steps: bool) -> Lines:
        """Each line with its own dose, as written or between whole motor steps."""
        moves = rounded_to_steps(self.moves, STEPS_PER_MM) if steps else self.moves
        return own_lines(moves, self.ul_per_e, LAYER_MM, planned=self.moves)


def rows(quick: bool) -> Iterator[Row]:
    """Yield all parts; quick has the slanted lumens alone."""
    with tempfile.TemporaryDirectory() as scratch:
        for make in (slanted,) if quick else (slanted, bifurcations, ventricle, gyroid):
            part = make()
            model = Path(scratch) / f"{part.name}.stl"
            part.write_stl(model)
            made, peers = slice_ours(part, model), slice_peers(part, model)
            if part.axes:
                yield from _axis_rows(part, made, peers)
            yield from _layer_rows(part, made, peers)
            least = min((one.cpu_s for one in peers.values()), default=None)
            more = {} if least is None else {"over_prusaslicer": made.cpu_s / least}
            yield row(f"{part.name}: CPU of the whole process", made.cpu_s, "s") | more


def _axis_rows(part: BentPart, made: Written, peers: dict[str, Written]) -> Iterator[Row]:
    for steps, goal in ((False, 5.0), (True, 10.0)):
        found = {name: _loss_um(part, one, steps=steps) for name, one in peers.items()}
        own = _loss_um(part, made, steps=steps)
        how = f"after {STEPS_PER_MM:g} steps/mm" if steps else "as written"
        for what, of, limit in (("median", np.median, goal), ("95 %", _most, 12.0)):
            peer = {name: float(of(value)) for name, value in found.items()}
            measure = f"{part.name}: lumens' loss of the widest free circle, {what}, {how}"
            value = float(of(own))
            met = value <= min([limit, *peer.values()])
            yield row(measure, value, "um", f"<= {limit:g}, and all settings'", met, peer)


def _most(values: NDArray[np.float64]) -> float:
    return float(np.percentile(values, 95))


def _loss_um(part: BentPart, written: Written, *, steps: bool) -> NDArray[np.float64]:
    """Designed diameter less the widest free circle's, median along each lumen, round sides."""
    lines, found = written.lines(steps=steps), []
    for axis in part.axes:
        moved = Axis(axis.name, axis.point + written.place, axis.along, axis.diameter)
        free = free_sections(lines, LAYER_MM, moved, rounded=True)
        found.append(1e3 * float(np.median(axis.diameter - free.inner)))
    return np.array(found)


def _layer_rows(part: BentPart, made: Written, peers: dict[str, Written]) -> Iterator[Row]:
    own = _layers(part, made)
    found = {name: _layers(part, one) for name, one in peers.items()}
    peer = {name: one.closed for name, one in found.items()}
    most = min([*peer.values(), 0])
    yield row(
        f"{part.name}: closed holes of sections", own.closed, "", "0", own.closed <= most, peer
    )
    peer = {name: one.bare_percent for name, one in found.items()}
    bare = own.bare_percent
    yield row(f"{part.name}: uncovered material", bare, "%", "<= 0.5", bare <= 0.5, peer)


def _layers(part: BentPart, written: Written) -> Any:
    def material(z: float) -> shapely.Geometry:
        found = shapely.Polygon()
        for ring in part.body.slice(z - LAYER_MM / 2 - written.place[2]).to_polygons():
            if len(ring) > 2:
                found = shapely.symmetric_difference(found, shapely.Polygon(ring).buffer(0))
        return shapely.transform(found, lambda points: points + written.place[:2])

    return compare_layers(written.lines(steps=False), material)


def slice_ours(part: BentPart, model: Path) -> Written:
    """What `printctl slice` writes of a part."""
    out = model.with_suffix(".ours.gcode")
    cpu, _, _ = timed(printctl("slice", model, "--unit", "mm", "--out", out))
    place = np.append(np.round(100.0 - part.middle[:2], 3), -part.middle[2])
    return Written(out, read_moves(out.read_text()), np.pi * SYRINGE_MM**2 / 4, place, cpu)


def slice_peers(part: BentPart, model: Path) -> dict[str, Written]:
    """What PrusaSlicer writes of it with each of `PEERS`; nothing where it isn't installed."""
    program, found = shutil.which("prusa-slicer"), {}
    for name, options in PEERS.items() if program else ():
        out = model.with_suffix(f".{name}.gcode")
        command = [str(program), "--load", str(PRUSA_INI), *options]
        command += ["--center", "30,30", "--export-gcode", "-o", str(out), str(model)]
        cpu, _, _ = timed(command)
        place = np.append(30.0 - part.middle[:2], -part.middle[2])
        moves, per_e = read_moves(out.read_text()), np.pi * FILAMENT_MM**2 / 4
        found[name] = Written(out, moves, per_e, place, cpu)
    return found
