"""Benchmark rows on defects: position and size of planted ones, false alarms on clean scans."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks.machine import row
from benchmarks.registration_cases import COARSE, as_designed, case
from benchmarks.registration_phantom import Defect, Setting, branched, moved, planar
from registration import RegistrationReport, register_scan

Row = dict[str, Any]

#: All in one print: a wall 60 um off, a channel of half its width, one full of gel over 0.8 mm, a
#: hole to the top, and a channel left out.
WRONG = (
    Defect("bulge", 7, 0.5, 0.06),
    Defect("stenosis", 8, 0.5, 0.2),
    Defect("occlusion", 5, 0.5, 0.8),
    Defect("leak", 1, 0.5, 0.12),
    Defect("missing", 6),
)


def defect_rows(quick: bool) -> Iterator[Row]:
    """Sizes of defects on order, and false alarms."""
    design = planar()
    model, network = as_designed(design)
    errors: dict[str, list[float]] = {defect.kind: [] for defect in WRONG}
    seeds = 1 if quick else 4
    missed = foreign = 0
    for seed in range(seeds):
        print(f"defects: seed {seed}", file=sys.stderr, flush=True)
        setting = moved(Setting(), defects=WRONG, turn_deg=3.0 * seed)
        found = register_scan(case(design, setting, seed).scan, model, network)
        made = _made(setting)
        for kind, (vessel, size) in made.items():
            here = [d for d in found.defects if d.kind == kind and d.vessel == vessel]
            missed += not here
            errors[kind] += [d.size_um - size for d in here]
        known = {(kind, vessel) for kind, (vessel, _) in made.items()}
        foreign += sum((d.kind, d.vessel) not in known for d in found.defects)
    count = seeds * len(WRONG)
    yield row(f"{count} defects on order: missed", missed, "", "0", missed == 0)
    yield row(f"{count} defects on order: others reported", foreign, "", "0", foreign == 0)
    for kind, off in errors.items():
        worst = float(np.abs(off).max()) if off else float("nan")
        yield row(f"{kind}: size's largest error", worst, "um", "<= 10", worst <= 10)
    alarms = _false_alarms(2 if quick else 20)
    yield row("false alarms on clean scans", alarms, "", "0", alarms == 0)


def _made(setting: Setting) -> dict[str, tuple[int, float]]:
    """Vessel and size, µm: widths as printed, the occlusion along the designed axis."""
    stretch = 1e3 * float(np.mean(setting.stretch[1:]))
    design = planar()
    return {
        "bulge": (7, 2 * 0.06 * stretch),
        "stenosis": (8, -2 * 0.2 * stretch),
        "occlusion": (5, 1e3 * 0.8),
        "leak": (1, 2 * 0.12 * stretch),
        "missing": (6, 2 * float(design.radius[6]) * 1e3),
    }


def _false_alarms(scans: int) -> int:
    """Defects reported in prints that have none."""
    alarms = 0
    for design in (planar(), branched()):
        model, network = as_designed(design)
        for seed in range(scans // 2):
            print(f"clean: {design.name}, seed {seed}", file=sys.stderr, flush=True)
            setting = moved(Setting(**COARSE), turn_deg=2.0 * seed - 10, tilt_x_deg=0.1 * seed)
            found: RegistrationReport = register_scan(
                case(design, setting, seed).scan, model, network
            )
            for defect in found.defects:
                print(defect, file=sys.stderr, flush=True)
            alarms += len(found.defects)
    return alarms
