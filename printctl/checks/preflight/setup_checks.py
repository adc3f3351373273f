"""Check that the syringe holds a job's ink, and the push per length the firmware must allow."""

from __future__ import annotations

import numpy as np

from firmware_profiles import Printer, Syringe
from printctl.checks.preflight.firmware import widest_push_check
from printctl.checks.preflight.profile_checks import profile_checks
from printctl.checks.set_up.check import Check
from sim.gcode.dry_run.run import DryRun


def syringe_check(run: DryRun, syringe: Syringe) -> Check:
    """Ink pushed at the farthest point, with what stays in the needle, against the filling."""
    area = syringe.area_mm2
    needed = run.plunger_max_mm * area + syringe.dead_volume_ul
    over = np.flatnonzero(run.program.plunger * area + syringe.dead_volume_ul > syringe.volume_ul)
    line = f"line {int(run.program.line[over[0]])}, " if len(over) else ""
    return Check(
        f"ink, with {syringe.dead_volume_ul:g} µL dead volume",
        needed,
        syringe.volume_ul,
        "µL",
        needed <= syringe.volume_ul,
        f"{line}syringe: volume_ul",
        f"more than {syringe.name} holds; use a larger syringe or a smaller part",
    )


def syringe_checks(run: DryRun, printer: Printer, syringe: Syringe) -> list[Check]:
    """What the syringe holds, and what the firmware must let it push.

    What a pneumatic head takes hangs on its flow, and so on ink and needle: `force_checks`.
    """
    if printer.pneumatic:
        return profile_checks(syringe)
    return [
        syringe_check(run, syringe),
        *widest_push_check(run, printer, syringe),
        *profile_checks(syringe),
    ]
