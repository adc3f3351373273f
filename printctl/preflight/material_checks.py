"""Ink and bath: do they set each other, are they as warm as they may be, does the bath hold."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from design.toolpath.embedded import held_diameter_mm
from firmware_profiles import Bath, Ink
from printctl.preflight.check import Check
from sim.dryrun import DryRun
from sim.gcode import code

_WORDS: Final = {
    "neutral_ph": "a buffer of neutral pH",
    "calcium": "calcium",
    "thrombin": "thrombin",
}


def chemistry_check(ink: Ink, bath: Bath) -> Check:
    """Whether the bath has what sets the ink; without it the print runs away."""
    missing = [trigger for trigger in ink.gelled_by if trigger not in bath.provides]
    needs = " and ".join(_WORDS[trigger] for trigger in missing)
    return Check(
        "what sets the ink and the bath lacks",
        len(missing),
        0,
        "",
        not missing,
        "bath: provides",
        f"{ink.name} sets by {needs}, which {bath.name} doesn't have (gelled_by, provides); take "
        "another bath, or say in its profile that it is in it",
    )


def bath_checks(bath: Bath) -> list[Check]:
    """Whether the bath holds while printing and still melts out; none for a bath that stays."""
    if bath.melt_out_c is None:
        return []
    return [
        Check(
            "printing temperature of the bath, below its melt-out",
            bath.max_printing_c,
            bath.melt_out_c,
            "°C",
            bath.max_printing_c < bath.melt_out_c,
            "bath: max_printing_c",
            f"mend the profile of {bath.name}: it would melt while it is printed in",
        )
    ]


def temperature_checks(run: DryRun, ink: Ink, bath: Bath) -> list[Check]:
    """What the job sets (M104, M109 for the ink, M140, M190 for the bath) against the materials."""
    span = ink.temperature_c
    return [
        _at_most(run, ("M104", "M109"), "warmest setting of the ink", span.high, "ink", ink.name),
        _at_least(run, ("M104", "M109"), "coldest setting of the ink", span.low, ink.name),
        _at_most(
            run,
            ("M140", "M190"),
            "warmest setting of the bath",
            bath.max_printing_c,
            "bath",
            bath.name,
        ),
    ]


def _at_most(
    run: DryRun, names: tuple[str, ...], what: str, limit: float, sort: str, name: str
) -> Check:
    value, line = _extreme(run, names, 1)
    key = "temperature_c" if sort == "ink" else "max_printing_c"
    remedy = f"{name} bears at most that ({sort}: {key}); lower the job's setting"
    passed = not line or value <= limit
    return Check(what, value if line else limit, limit, "°C", passed, _at(line), remedy)


def _at_least(run: DryRun, names: tuple[str, ...], what: str, limit: float, name: str) -> Check:
    value, line = _extreme(run, names, -1)
    remedy = f"{name} bears at least that (ink: temperature_c); raise the job's setting"
    passed = not line or value >= limit
    return Check(what, value if line else limit, limit, "°C", passed, _at(line), remedy)


def _at(line: int) -> str:
    return f"line {line}" if line else "not set by the job"


def _extreme(run: DryRun, names: tuple[str, ...], sign: int) -> tuple[float, int]:
    """Highest (or lowest) temperature that commands set, and its line; 0 switches off."""
    program = run.program
    sets = np.isin(program.code, [code(name) for name in names]) & (program.value > 0)
    rows = np.flatnonzero(sets)
    if not len(rows):
        return 0.0, 0
    row = rows[int((sign * program.value[rows]).argmax())]
    return float(program.value[row]), int(program.line[row])


def held_check(widest_mm: float, ink: Ink, bath: Bath) -> Check:
    """The thickest filament written, against what the bath's yield stress holds up."""
    held = held_diameter_mm(bath, ink)
    # Where densities are equal nothing sinks; a limit must be a number all the same.
    limit = held if math.isfinite(held) else widest_mm
    return Check(
        "thickest filament in the bath",
        widest_mm,
        limit,
        "mm",
        widest_mm <= limit,
        "bath: yield_stress_pa, density_g_cm3",
        f"{ink.name} would sink or float in {bath.name}; write it thinner, or take a bath with "
        "more yield stress or nearer in density",
        "refuses" if bath.calibrated and ink.calibrated else "warns",
    )
