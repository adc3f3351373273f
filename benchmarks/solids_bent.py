"""Benchmark rows on slanted, bent or branching lumens, compared with PrusaSlicer.

Its third settings, "precise", are classic walls without any simplification of outlines.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from benchmarks.checkers.bead_lumens import Axis, free_sections
from benchmarks.checkers.layer_sections import compare_layers
from benchmarks.checkers.read_gcode import Lines, Moves, own_lines, read_moves, rounded_to_steps
from benchmarks.machine import ROOT, row
from benchmarks.solids_bent_parts import BentPart, bifurcations, gyroid, slanted, ventricle

Row = dict[str, Any]
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
    """A file, its moves, what a millimetre of E is, and the part's origin in its frame."""

    file: Path
    moves: Moves
    ul_per_e: float
    place: NDArray[np.float64]

    def lines(self, *, steps: bool) -> Lines:
        """Each line with its own dose, as written or between whole motor steps."""
        moves = rounded_to_steps(self.moves, STEPS_PER_MM) if steps else self.moves
        return own_lines(moves, self.ul_per_e, LAYER_MM, planned=self.moves)


def rows() -> Iterator[Row]:
    """All rows."""
    with tempfile.TemporaryDirectory() as scratch:
        for part in (slanted(), bifurcations(), ventricle(), gyroid()):
            model = Path(scratch) / f"{part.name}.stl"
            part.write_stl(model)
            made, peers = slice_ours(part, model), slice_peers(part, model)
            if part.axes:
                yield from _axis_rows(part, made, peers)
            yield from _layer_rows(part, made, peers)


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
    command = [sys.executable, "-m", "printctl", "slice", str(model), "--unit", "mm"]
    subprocess.run([*command, "--out", str(out)], check=True, capture_output=True)
    place = np.append(np.round(100.0 - part.middle[:2], 3), -part.middle[2])
    return Written(out, read_moves(out.read_text()), np.pi * SYRINGE_MM**2 / 4, place)


def slice_peers(part: BentPart, model: Path) -> dict[str, Written]:
    """What PrusaSlicer writes of it with each of `PEERS`; nothing where it isn't installed."""
    program, found = shutil.which("prusa-slicer"), {}
    for name, options in PEERS.items() if program else ():
        out = model.with_suffix(f".{name}.gcode")
        command = [str(program), "--load", str(ROOT / "benchmarks" / "solids_prusa.ini"), *options]
        command += ["--center", "30,30", "--export-gcode", "-o", str(out), str(model)]
        subprocess.run(command, check=True, capture_output=True)
        place = np.append(30.0 - part.middle[:2], -part.middle[2])
        found[name] = Written(out, read_moves(out.read_text()), np.pi * FILAMENT_MM**2 / 4, place)
    return found
