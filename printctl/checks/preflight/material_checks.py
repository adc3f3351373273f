"""Check a job's temperatures against the limits of ink and bath."""

from __future__ import annotations

from typing import Final

from firmware_profiles import Bath, Ink
from printctl.checks.gate import UNNAMED_C
from printctl.checks.set_up.check import Check
from sim.gcode.dry_run.run import DryRun

_INK: Final = "temperature_c"


def temperature_checks(run: DryRun, ink: Ink, bath: Bath | None) -> list[Check]:
    """Check every set temperature against the limits of ink and bath; 0 switches off."""
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
