"""Predict a job's hardest push; check pressure, plunger force and shear stress on the cells.

No machine of ours reports force or pressure, so this is a prediction: the steady flow of the ink
through the needle (`firmware_profiles.materials.rheology`), on the plunger the syringe's friction
besides where it is known; entry losses left out. Newtonian ink with a low-shear viscosity is
predicted far too stiff; so only measured inks refuse a print.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from firmware_profiles import (
    Ink,
    Needle,
    Printer,
    Syringe,
    pressure_pa,
    wall_stress_pa,
    yield_pressure_pa,
)
from gcode.dry_run.run import DryRun
from printctl.checks.kinds import Kind
from printctl.checks.preflight.mounted import profile_checks
from printctl.checks.preflight.pneumatic_checks import air_checks, speed_checks
from printctl.checks.set_up import Check


@dataclass(frozen=True)
class Push:
    """The hardest push of a job.

    Attributes
    ----------
    flow_ul_s : float, µL/s
        Through the needle: what is pushed, times the ink's flow factor.
    pressure_pa, force_n, shear_pa : float, Pa, N, Pa
        In the syringe, on the plunger, at the needle's wall.
    line : int
        Of the G-code; 0 where nothing is pushed.
    """

    flow_ul_s: float
    pressure_pa: float
    force_n: float
    shear_pa: float
    line: int


def hardest_push(run: DryRun, ink: Ink, needle: Needle, syringe: Syringe) -> Push:
    """Where the most flows, and what that takes; going back is no push.

    The flow is the plunger's. Where the ink's lag was measured with this needle and syringe, a push
    from rest while the needle stands gives Q (1 - e^(-t/τ)): too short to press harder.
    """
    area = syringe.area_mm2
    speed = np.where(run.doses, run.speed_mm_s[:, 3], 0.0)
    if ink.lag is not None and (ink.lag.needle, ink.lag.syringe) == (needle.name, syringe.name):
        stands = (run.speed_mm_s[:, :3] == 0).all(axis=1) & (speed > 0)
        lasts = np.divide(run.program.pushed, speed, out=np.zeros(len(speed)), where=stands)
        speed = np.where(stands, -speed * np.expm1(-lasts / ink.lag.lag_s), speed)
    row = int(speed.argmax()) if len(speed) else -1
    if row < 0 or speed[row] == 0:
        return Push(0.0, 0.0, 0.0, 0.0, 0)
    flow = float(speed[row]) * area * ink.flow_factor
    pressure = pressure_pa(ink, needle, flow)
    return Push(
        flow,
        pressure,
        pressure * area * 1e-6 + (syringe.friction_n or 0.0),
        wall_stress_pa(ink, needle.inner_mm, flow),
        int(run.program.line[row]),
    )


def force_checks(
    run: DryRun, ink: Ink, needle: Needle, syringe: Syringe, printer: Printer
) -> list[Check]:
    """The hardest push against what syringe, head and cells bear, where their profiles say it.

    A pneumatic head's pressure is what it is set to (`air_checks`), not what the flow asks for.
    """
    speeds = speed_checks(run, ink, printer)
    if printer.pneumatic:
        return [*air_checks(run, ink, needle, syringe, printer), *speeds]
    push = hardest_push(run, ink, needle, syringe)
    friction = "" if syringe.friction_n is not None else ", syringe friction unknown"
    rows = (
        (
            Kind.PRESSURE,
            "pressure in the syringe",
            push.pressure_pa * 1e-3,
            syringe.max_pressure_kpa,
            "kPa",
            f"{syringe.name}: max_pressure_kpa",
        ),
        (
            Kind.PLUNGER_FORCE,
            f"plunger force{friction}",
            push.force_n,
            printer.max_plunger_force_n,
            "N",
            f"{printer.name}: max_plunger_force_n",
        ),
        (
            Kind.SHEAR_STRESS,
            "shear stress at the needle wall",
            push.shear_pa,
            ink.max_shear_stress_pa,
            "Pa",
            f"{ink.name}: max_shear_stress_pa",
        ),
    )
    limits = [
        Check(
            kind,
            f"{name}, at {push.flow_ul_s:.3g} µL/s",
            value,
            limit,
            unit,
            value <= limit,
            f"line {push.line}",
            f"exceeds the maximum ({whose}); print more slowly, or use a wider or shorter needle",
            "refuses" if ink.calibrated else "warns",
        )
        for kind, name, value, limit, unit, whose in rows
        if limit is not None
    ]
    return [*profile_checks(needle, ink), *limits, *_held(ink, needle), *speeds]


def _held(ink: Ink, needle: Needle) -> list[Check]:
    """A yield stress holds pressure in the needle: the plunger's relief must be told of it."""
    held = yield_pressure_pa(ink, needle)
    if held == 0 or ink.retract_ul > 0:
        return []
    return [
        Check(
            Kind.HELD_PRESSURE,
            "residual pressure in the needle after extrusion",
            held * 1e-3,
            0,
            "kPa",
            False,
            f"{ink.name}: yield_stress_pa, retract_ul",
            "it isn't relieved (retract_ul 0), so the needle oozes during travel; set retract_ul",
            "warns",
        )
    ]
