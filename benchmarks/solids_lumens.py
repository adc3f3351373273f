"""Benchmark rows: `printctl lumens` against an independent reader at the same places.

Both measure the widest free circle along each whole lumen of the slanted part, of files of
printctl's and of PrusaSlicer's; what is compared is each lumen's median. PrusaSlicer's E has five
digits of a 1.75 mm filament: 5 % of a line of 50 µm. So the reader takes its doses over 1 mm.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.checkers.read_gcode import Lines, written_lines
from benchmarks.checkers.widest_circles import along_path, at_mid_layer, widest_circles
from benchmarks.machine import row
from benchmarks.solids_bent import FILAMENT_MM, LAYER_MM, Written, slice_ours, slice_peers
from benchmarks.solids_bent_parts import BentPart, slanted

Row = dict[str, Any]
STEP_MM = 0.05
WITHIN_UM = 3.0
COLUMNS = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree"
FILAMENT_AREA_MM2 = np.pi * FILAMENT_MM**2 / 4
OWN, PEER = ["--syringe", "hamilton_1ml"], ["--filament-mm", f"{FILAMENT_MM:g}"]


def rows() -> Iterator[Row]:
    """All rows."""
    with tempfile.TemporaryDirectory() as scratch:
        part = slanted()
        model, network = Path(scratch) / "slanted.stl", Path(scratch) / "network.csv"
        part.write_stl(model)
        _write_network(part, network)
        files = {"printctl": (slice_ours(part, model), OWN)}
        files |= {f"PrusaSlicer, {k}": (v, PEER) for k, v in slice_peers(part, model).items()}
        for name, (written, said) in files.items():
            yield _row(part, name, written, _told_um(written, network, said))


def _row(part: BentPart, name: str, written: Written, told: NDArray[np.float64]) -> Row:
    """Told less found error of the lumens' diameters; 5, 50 and 95 % of the lumens."""
    away = told - _found_um(part, written)
    low, middle, high = np.percentile(away, [5, 50, 95])
    worst = float(max(-low, high))
    measure = f"slanted, file of {name}: lumens against the outside reader, 5 and 95 %"
    found = row(measure, worst, "um", f"<= {WITHIN_UM:g}", worst <= WITHIN_UM)
    return found | {
        "percentiles_5_50_95": [round(float(value), 2) for value in (low, middle, high)],
        "furthest": round(float(away[np.abs(away).argmax()]), 2),
        "lumens": len(away),
    }


def _found_um(part: BentPart, written: Written) -> NDArray[np.float64]:
    """Median of each lumen's open less its designed diameter, by the benchmark's reader."""
    lines, found = _lines(written), []
    for name, path, radius in part.paths:
        axis = along_path(name, path + written.place, radius, STEP_MM)
        axis = at_mid_layer(axis, lines, LAYER_MM)
        found.append(1e3 * np.median(widest_circles(lines, LAYER_MM, axis) - axis.diameter))
    return np.array(found)


def _lines(written: Written) -> Lines:
    if written.ul_per_e != FILAMENT_AREA_MM2:
        return written.lines(steps=False)
    return written_lines(written.moves, written.ul_per_e, LAYER_MM, rounded=True)


def _told_um(written: Written, network: Path, said: list[str]) -> NDArray[np.float64]:
    """The same by `printctl lumens`, which ends with 3 where a lumen leaks or is closed."""
    place = ",".join(f"{value:.6f}" for value in written.place)
    command = [sys.executable, "-m", "printctl", "lumens", str(written.file), *said]
    command += ["--network", str(network), "--unit", "mm", f"--place={place}", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 3):
        raise RuntimeError(f"printctl lumens ended with {done.returncode}: {done.stderr}")
    told = json.loads(done.stdout)["lumens"]
    by_name = {int(one["lumen"]): one["diameter_error_median_um"] for one in told}
    return np.array([by_name[number] for number in sorted(by_name)])


def _write_network(part: BentPart, path: Path) -> None:
    """The lumens as a network of single vessels, each a tree of its own."""
    lines, node = [COLUMNS], 0
    for vessel, (_, points, radius) in enumerate(part.paths):
        for k in range(len(points) - 1):
            ends = ",".join(repr(float(v)) for v in (*points[k], *points[k + 1], radius, radius))
            lines.append(f"{vessel},{node + k},{node + k + 1},{ends},artery,{vessel}")
        node += len(points)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
