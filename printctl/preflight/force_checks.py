"""What it takes to push the ink: pressure, force on the plunger, shear on the cells.

No machine of ours reports force or pressure, so this is a prediction: the steady flow of a
power-law fluid through the needle (entry losses and the barrel's friction left out). Newtonian ink
with a low-shear viscosity is predicted far too stiff; so only measured inks refuse a print.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from firmware_profiles import Ink, Needle, Printer, Syringe
from printctl.preflight.check import Check
from sim.dryrun import DryRun


@dataclass(frozen=True)
class Push:
    """The hardest push of a job.

    Attributes
    ----------
    flow_ul_s : float, µL/s
    pressure_pa, force_n, shear_pa : float, Pa, N, Pa
        In the syringe, on the plunger, at the needle's wall.
    line : int
        Of the G-code.
    """

    flow_ul_s: float
    pressure_pa: float
    force_n: float
    shear_pa: float
    line: int


def wall_shear_pa(ink: Ink, bore_mm: float, flow_ul_s: float) -> float:
    """Shear stress at the needle's wall, Pa: K ((3n + 1)/n · Q/(πR³))ⁿ.

    Power law, laminar, no slip (Weissenberg and Rabinowitsch); at n = 1 it is 4ηQ/(πR³).
    """
    n, radius = ink.flow_index, bore_mm / 2
    rate = (3 * n + 1) / n * flow_ul_s / (math.pi * radius**3)
    return float(ink.viscosity_pa_s * rate**n)


def hardest_push(run: DryRun, ink: Ink, needle: Needle, syringe: Syringe) -> Push:
    """Where the plunger is driven fastest, and what that takes: Δp = 2 τ_w L / R."""
    area = math.pi / 4 * syringe.inner_mm**2
    row = int(run.speed_mm_s[:, 3].argmax()) if len(run.speed_mm_s) else -1
    flow = float(run.speed_mm_s[row, 3]) * area if row >= 0 else 0.0
    shear = wall_shear_pa(ink, needle.inner_mm, flow)
    pressure = 4 * shear * needle.length_mm / needle.inner_mm
    line = int(run.program.line[row]) if row >= 0 else 0
    return Push(flow, pressure, pressure * area * 1e-6, shear, line)


def force_checks(
    run: DryRun, ink: Ink, needle: Needle, syringe: Syringe, printer: Printer
) -> list[Check]:
    """The hardest push against what syringe, head and cells bear, where their profiles say it."""
    push = hardest_push(run, ink, needle, syringe)
    rows = (
        (
            "pressure in the syringe",
            push.pressure_pa * 1e-3,
            syringe.max_pressure_kpa,
            "kPa",
            f"{syringe.name}: max_pressure_kpa",
        ),
        (
            "force on the plunger",
            push.force_n,
            printer.max_plunger_force_n,
            "N",
            f"{printer.name}: max_plunger_force_n",
        ),
        (
            "shear stress at the needle's wall",
            push.shear_pa,
            ink.max_shear_stress_pa,
            "Pa",
            f"{ink.name}: max_shear_stress_pa",
        ),
    )
    return [
        Check(
            f"{name}, at {push.flow_ul_s:.3g} µL/s",
            value,
            limit,
            unit,
            value <= limit,
            f"line {push.line}",
            f"above what is allowed ({whose}); write slower, or take a wider or shorter needle",
            "refuses" if ink.calibrated else "warns",
        )
        for name, value, limit, unit, whose in rows
        if limit is not None
    ]
