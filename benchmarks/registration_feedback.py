"""Benchmark of compensation: print deviation before and after corrections.

Simulated prints shrink by 2.5 %, and their lines hold more ink than they were dosed (a quarter, or
a tenth). Through the command line: run, compensate, run, compensate, run. What each print is off by
is told by `checkers.printed_shape` from the ink itself; the product's own report stands beside it.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.checkers.printed_shape import NEAR_MM, Ink, Shape, measure, vessels_of
from benchmarks.machine import ROOT, row
from sim.gcode.deposit.lay import deposit
from sim.gcode.motion.executed import ExecutedMotion

Row = dict[str, Any]

SHRINK = 2.5


@dataclass(frozen=True)
class Case:
    """An example, how it is scanned, and how finely its ink is measured.

    Attributes
    ----------
    scan : dict
        Of the recipe.
    spread_percent : float
        More ink than was dosed.
    voxel_mm : float, mm
    """

    scan: dict[str, Any]
    spread_percent: float
    voxel_mm: float


CASES: Mapping[str, Case] = {
    "planar_fresh": Case({"simulated": "oct", "voxel_um": [25, 25, 15]}, 25.0, 0.02),
    # A quarter more would widen the 2.6 mm trunk by more than a compensation may take back.
    "cortex_embedded": Case({"simulated": "microct", "voxel_um": [80, 80, 80]}, 10.0, 0.06),
}
STANDARD = "the simulator's own voxels"


def feedback_rows(quick: bool) -> Iterator[Row]:
    """Deviation and diameters before, and after one and two rounds."""
    for name in list(CASES)[: 1 if quick else None]:
        for standard in (False, True):
            if quick and standard:
                continue
            said = "depth standard" if standard else "no depth standard"
            shapes, reports = rounds(name, 1 if quick else 2, standard)
            yield from _rows(f"{name}, {said}", shapes, reports)


def rounds(name: str, count: int, standard: bool) -> tuple[list[Shape], list[Row]]:
    """Shapes and reports of a first print and `count` compensated ones."""
    shapes: list[Shape] = []
    reports: list[Row] = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for number in range(count + 1):
            _write_recipe(folder, name, number)
            _printctl(folder, "run", f"{number}.yaml", "--out", f"run{number}", codes=(0, 1))
            if number < count:
                word = ["--depth-standard", STANDARD] if standard else []
                made = f"made{number}.yaml"
                _printctl(folder, "compensate", f"run{number}", "--out", made, *word)
            shapes.append(shape_of(folder / f"run{number}", CASES[name]))
            reports.append(json.loads((folder / f"run{number}" / "registration.json").read_text()))
    return shapes, reports


def _write_recipe(folder: Path, name: str, number: int) -> None:
    data = yaml.safe_load((ROOT / "examples" / f"{name}.yaml").read_text())
    # A seed for each: no two prints lie alike under the scanner.
    lab = {"shrink_percent": SHRINK, "spread_percent": CASES[name].spread_percent}
    data["scan"] = CASES[name].scan | lab | {"seed": 100 + number}
    if number:
        data["toolpath"]["compensation"] = f"made{number - 1}.yaml"
    (folder / f"{number}.yaml").write_text(yaml.safe_dump(data))


def _printctl(folder: Path, *said: str, codes: tuple[int, ...] = (0,)) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "printctl", *said],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode not in codes:
        raise RuntimeError(f"printctl {' '.join(said)}: {done.stderr}")


def shape_of(run: Path, case: Case) -> Shape:
    """A run's print against its design, from the motion of the simulated motors."""
    facts = json.loads((run / "manifest.json").read_text())["facts"]
    bore = facts["profiles"]["syringe"]["inner_mm"]
    dosed = math.pi / 4 * bore**2 * facts["profiles"]["ink"]["flow_factor"]
    step = 1 / facts["profiles"]["printer"]["steps_per_mm"]["e"]
    motion = ExecutedMotion.load(run / "executed.npz")
    laid = deposit(
        motion, dosed * (1 + case.spread_percent / 100), case.voxel_mm, plunger_step_mm=step
    )
    left = 1 - SHRINK / 100
    vessels = vessels_of(run / "network.csv")
    size = facts["recipe"]["tissue"].get("size_mm")
    body = laid.style == "layered"
    block = np.array([[0.0, 0.0, 0.0], size]) if body and size else None
    design = np.array([vessels.start.min(axis=0), vessels.end.max(axis=0)])
    middle = (block if block is not None else design).mean(axis=0)
    filled = laid.volume.astype(np.float32) / np.float32(255)
    # Back from the printer's frame and shrunk about the middle; `measure` finds the best shift.
    place = np.array(facts["frames"]["part_to_printer"])[:3, 3]
    origin = middle + left * (laid.origin_mm - place - middle)
    return measure(Ink(filled, origin, np.full(3, left * case.voxel_mm)), vessels, block)


def _rows(name: str, shapes: list[Shape], reports: list[Row]) -> Iterator[Row]:
    first, last = shapes[0], shapes[-1]
    for number, (shape, report) in enumerate(zip(shapes, reports, strict=True)):
        said = f"{name}, {('before', 'after 1 round', 'after 2 rounds')[number]}"
        near = f"{said}: ink against design, surface within {NEAR_MM} mm"
        yield row(f"{near}, median", shape.median_um, "um")
        yield row(f"{near}, p95", shape.p95_um, "um")
        yield row(f"{said}: surface farther than that", shape.dropped_percent, "%")
        yield row(f"{said}: diameters off by, mean of {shape.lumens}", shape.diameter_um, "um")
        yield row(f"{said}: axes off by, mean", shape.offset_um, "um")
        yield row(f"{said}: report's rigid p95", report["rigid"]["p95_um"], "um")
    for what, key in (("p95", "p95_um"), ("diameters", "diameter_um")):
        ratio = getattr(last, key) / getattr(first, key)
        yield row(f"{name}: {what} after over before", ratio, "", "< 0.5", ratio < 0.5)
