"""Slicing benchmark rows: open lumens, coverage, travel, time; compared with PrusaSlicer.

Both slice the same STL files in processes of their own; a reader and checkers of the benchmark's
measure what G-code they wrote.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from benchmarks.checkers.read_gcode import (
    Lines,
    Moves,
    read_moves,
    rounded_to_steps,
    trips,
    written_lines,
)
from benchmarks.checkers.round_lumens import crossings, openings, unfilled
from benchmarks.machine import ROOT, peak_mb, row
from benchmarks.solids_parts import Part, block, channel, small, tubes

Row = dict[str, Any]
LAYER_MM, LINE_MM, STEPS_PER_MM = 0.06, 0.15, 80.0
#: Lumens at least so wide are held to the first goal, mm.
WIDE_MM = 0.3
SYRINGE_MM, FILAMENT_MM = 4.61, 1.75
BED_MM = np.array([100.0, 100.0])
PRUSA_BED_MM = np.array([30.0, 30.0])


@dataclass(frozen=True)
class Sliced:
    """What a slicer made of a part."""

    moves: Moves
    ul_per_e: float
    rounded: bool
    centre: NDArray[np.float64]
    layer_mm: float
    cpu_s: float
    memory_mb: float

    def lines(self, *, steps: bool) -> Lines:
        """The lines it wrote, ideally or as motors of whole steps make them."""
        moves = rounded_to_steps(self.moves, STEPS_PER_MM) if steps else self.moves
        return written_lines(
            moves, self.ul_per_e, self.layer_mm, rounded=self.rounded, planned=self.moves
        )


def rows() -> Iterator[Row]:
    """All rows of the slicing promises."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        _ours(small(), folder)  # kernels are loaded from their cache from now on
        for part in (block(), tubes()):
            made = _ours(part, folder)
            peers = _peers(part, folder)
            yield from _wide_rows(part, made, peers)
        yield from _small_rows(small(), _ours(small(), folder), _peers(small(), folder))
        fine = _ours(channel(), folder, layer_mm=0.04, line_mm=0.08)
        yield from _channel_rows(channel(), fine)


def _wide_rows(part: Part, made: Sliced, peers: dict[str, Sliced]) -> Iterator[Row]:
    name = part.name
    for steps, goal in ((False, 2.0), (True, 8.0)):
        error = _errors_um(part, made, steps=steps)
        median, worst = float(np.median(error)), float(error[np.abs(error).argmax()])
        how = f"after {STEPS_PER_MM:g} steps/mm" if steps else "ideal lines"
        peer = {
            key: float(np.median(_errors_um(part, of, steps=steps))) for key, of in peers.items()
        }
        measure = f"{name}: lumens' median diameter error, {how}"
        yield row(measure, median, "um", f"within {goal:g}", abs(median) <= goal, peer)
        if not steps:
            measure = f"{name}: the worst lumen's error, {how}"
            yield row(measure, worst, "um", "within 10", abs(worst) <= 10)
    closed = int((_open(part, made) <= 0).sum())
    yield row(f"{name}: layers in which a lumen is closed", closed, "", "0", closed == 0)
    bare = 100 * _bare(part, made)
    peer = {key: 100 * _bare(part, of) for key, of in peers.items()}
    what = "wall of 0.25 mm" if part.wall_mm else "solid at 100 %"
    yield row(f"{name}: unfilled part of the {what}", bare, "%", "<= 1", bare <= 1, peer)
    found = {key: _crossed(part, of) for key, of in (("", made), *peers.items())}
    peer = {key: value for key, value in found.items() if key}
    yield row(f"{name}: travels that cross a lumen", found[""], "%", "0", found[""] == 0, peer)
    least = min((of.cpu_s for of in peers.values()), default=float("nan"))
    peer = {key: round(of.cpu_s, 1) for key, of in peers.items()}
    goal = "<= 1.0 x PrusaSlicer's least"
    met = made.cpu_s <= least if peers else None
    yield row(f"{name}: CPU of the whole process", made.cpu_s, "s", goal, met, peer) | {
        "memory_mb": round(made.memory_mb),
        "peer_memory_mb": {key: round(of.memory_mb) for key, of in peers.items()},
    }


def _small_rows(part: Part, made: Sliced, peers: dict[str, Sliced]) -> Iterator[Row]:
    found = np.median(_open(part, made), axis=0)
    closed = int((found < 0.5 * part.inscribed).sum())
    peer = {
        key: np.round(np.median(_open(part, of), axis=0), 3).tolist() for key, of in peers.items()
    }
    made_row = row(
        f"{part.name}: closed, of 6 (below half the width)", closed, "", "0", closed == 0, peer
    )
    yield made_row | {
        "open_mm": np.round(found, 3).tolist(),
        "of": part.inscribed.round(3).tolist(),
    }


def _channel_rows(part: Part, made: Sliced) -> Iterator[Row]:
    found = 1e3 * float(np.median(_open(part, made)))
    designed = 1e3 * float(part.inscribed[0])
    measure = f"{part.name}, lines of 80 um in layers of 40 um: open diameter"
    yield row(measure, found, "um", f"{designed:.1f} within 10", abs(found - designed) <= 10)


def _open(part: Part, made: Sliced, *, steps: bool = False) -> NDArray[np.float64]:
    """Open diameter of every lumen in every layer."""
    reach = float(part.diameter.max()) / 2 + 2 * LINE_MM
    return openings(made.lines(steps=steps), part.centre + made.centre, reach).diameter


def _errors_um(part: Part, made: Sliced, *, steps: bool) -> NDArray[np.float64]:
    found: NDArray[np.float64] = np.median(_open(part, made, steps=steps), axis=0) - part.inscribed
    return 1e3 * found[part.diameter >= WIDE_MM]


def _bare(part: Part, made: Sliced) -> float:
    """Unfilled part of two layers in the middle, one for each direction of the infill."""
    material = shapely.Polygon()
    for ring in part.section().to_polygons():
        material = shapely.symmetric_difference(material, shapely.Polygon(ring))
    moved = shapely.transform(material, lambda points: points + made.centre)
    lines = made.lines(steps=False)
    heights = np.unique(np.round(lines.z, 4))
    middle = len(heights) // 2
    return float(np.mean([unfilled(lines, z, moved) for z in heights[middle : middle + 2]]))


def _crossed(part: Part, made: Sliced) -> float:
    """Travels over an open lumen, % of all."""
    found = trips(made.moves)
    count = crossings(found, part.centre + made.centre, part.inscribed / 2, made.layer_mm)
    return 100 * count / max(len(found), 1)


def _stl(part: Part, folder: Path) -> Path:
    path = folder / f"{part.name.replace(' ', '_')}.stl"
    if not path.exists():
        part.write_stl(path)
    return path


def _middle(part: Part) -> NDArray[np.float64]:
    """Middle of the part's bounds, where slicers put the bed's middle."""
    if not part.wall_mm:
        return np.array(part.size[:2]) / 2
    reach = (part.diameter / 2 + part.wall_mm)[:, None]
    corners = np.vstack([part.centre - reach, part.centre + reach])
    return np.asarray((corners.min(axis=0) + corners.max(axis=0)) / 2)


def _ours(part: Part, folder: Path, layer_mm: float = LAYER_MM, line_mm: float = LINE_MM) -> Sliced:
    model, out = _stl(part, folder), folder / "ours.gcode"
    command = [sys.executable, "-m", "printctl", "slice", str(model), "--unit", "mm"]
    command += ["--layer-um", f"{1e3 * layer_mm:g}", "--line-um", f"{1e3 * line_mm:g}"]
    cpu, memory = timed([*command, "--out", str(out)])
    middle = np.round(BED_MM - _middle(part), 3)
    per_e = np.pi * SYRINGE_MM**2 / 4
    return Sliced(read_moves(out.read_text()), per_e, True, middle, layer_mm, cpu, memory)


def _peers(part: Part, folder: Path) -> dict[str, Sliced]:
    """PrusaSlicer with its default walls and its classic ones; none where it isn't installed."""
    program = shutil.which("prusa-slicer") or shutil.which("PrusaSlicer")
    if program is None:
        return {}
    found = {}
    for walls in ("arachne", "classic"):
        out = folder / "prusa.gcode"
        command = [program, "--load", str(ROOT / "benchmarks" / "solids_prusa.ini")]
        command += ["--perimeter-generator", walls, "--center", "30,30"]
        print(f"{part.name}: PrusaSlicer, {walls} walls", file=sys.stderr, flush=True)
        cpu, memory = timed([*command, "--export-gcode", "-o", str(out), str(_stl(part, folder))])
        centre = PRUSA_BED_MM - _middle(part)
        moves, per_e = read_moves(out.read_text()), np.pi * FILAMENT_MM**2 / 4
        found[f"PrusaSlicer, {walls}"] = Sliced(moves, per_e, True, centre, LAYER_MM, cpu, memory)
    return found


def timed(command: list[str]) -> tuple[float, float]:
    """Run a command; CPU seconds of the whole process and its greatest memory, MB."""
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(command, stdout=said, stderr=subprocess.STDOUT)
        ended, held = 0, 0.0
        while not ended:
            held = max(held, peak_mb(process.pid))
            ended, status, usage = os.wait4(process.pid, os.WNOHANG)
            time.sleep(0 if ended else 0.02)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            said.seek(0)
            raise RuntimeError(f"{command[0]} ended with {process.returncode}: {said.read()!r}")
    return usage.ru_utime + usage.ru_stime, held
