"""Ink and bath: do they set each other, are they as warm as they may be, does the bath hold."""

from __future__ import annotations

import math
from typing import Final

from design.toolpath.embedded import held_diameter_mm
from firmware_profiles import Bath, Ink
from printctl.gate import UNNAMED_C
from printctl.preflight.profile_checks import profile_checks
from printctl.set_up.check import Check
from sim.dryrun import DryRun

_INK: Final = "temperature_c"
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
    """Whether the bath holds while printing and still melts out; whether its profile is whole."""
    others = [check for check in profile_checks(bath) if check.place != "max_printing_c"]
    if bath.melt_out_c is None:
        return others
    return [
        Check(
            "printing temperature of the bath, below its melt-out",
            bath.max_printing_c,
            bath.melt_out_c,
            "°C",
            bath.max_printing_c < bath.melt_out_c,
            "bath: max_printing_c",
            f"mend the profile of {bath.name}: it would melt while it is printed in",
        ),
        *others,
    ]


def temperature_checks(run: DryRun, ink: Ink, bath: Bath | None) -> list[Check]:
    """What the job sets, by whatever command, against what ink and bath bear; 0 switches off."""
    span = ink.temperature_c
    bears = f"{ink.name} bears at most that (ink: {_INK})"
    unnamed = "no bath is named, and cells bear no more; name it (--bath) if it does"
    warmest = (
        (UNNAMED_C, unnamed)
        if bath is None
        else (bath.max_printing_c, f"{bath.name} bears at most that (bath: max_printing_c)")
    )
    return [
        _setting(run, "ink", "warmest", span.high, bears),
        _setting(run, "ink", "coldest", span.low, f"{ink.name} bears at least that (ink: {_INK})"),
        _setting(run, "bath", "warmest", *warmest),
    ]


def _setting(run: DryRun, part: str, which: str, limit: float, bears: str) -> Check:
    """The warmest or coldest setting of one part against its limit."""
    sign, bounds = (1, ("is", "least")) if which == "warmest" else (-1, ("is", "most"))
    those = [
        heat
        for heat in run.heats
        if heat.part in (part, "both") and heat.celsius != 0 and heat.bound in bounds
    ]
    worst = max(those, key=lambda heat: sign * heat.celsius, default=None)
    return Check(
        f"{which} setting of the {part}",
        limit if worst is None else worst.celsius,
        limit,
        "°C",
        worst is None or sign * worst.celsius <= sign * limit,
        "not set by the job" if worst is None else f"line {worst.line}",
        f"{bears}; {'lower' if sign > 0 else 'raise'} the job's setting",
    )


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
