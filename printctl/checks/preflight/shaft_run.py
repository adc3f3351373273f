"""Run the needle shaft check on a simulated embedded job, with its map and mounted needles."""

from __future__ import annotations

from collections.abc import Sequence

from firmware_profiles import Needle, Printer
from kernels.arrays import FloatArray
from printctl.checks.preflight.ink_volumes import volumes
from printctl.checks.preflight.shaft_map import ShaftMap
from printctl.checks.set_up import HeadLoading
from sim.gcode.clearance import Clearance, NeedleBody, check_clearance, motion_of
from sim.gcode.dry_run.run import DryRun


def shaft_clearance(
    run: DryRun, printer: Printer, loads: Sequence[HeadLoading], written: ShaftMap
) -> Clearance:
    """Check every move of a run; a head whose needle nobody named has the one planned for.

    Raises
    ------
    ClearanceError
        When map and G-code aren't of one job.
    """
    planned = written.needles_mm
    bodies = [
        _body(load.needle, planned[min(k, len(planned) - 1)], written.clearance_mm)
        for k, load in enumerate(loads)
    ]
    motion = motion_of(run, written.sources, volumes(run, printer, loads))
    return check_clearance(motion, written.network, bodies, written.overlap_radii)


def _body(needle: Needle | None, planned_mm: FloatArray, clearance_mm: float) -> NeedleBody:
    """The mounted needle, or the planned one: its outer diameter, its tip's, its cone's height."""
    if needle is None:
        outer, tip, cone = planned_mm.tolist()
        return NeedleBody(outer / 2, tip / 2, cone, clearance_mm=clearance_mm)
    return NeedleBody(
        needle.outer_mm / 2,
        (needle.tip_outer_mm or needle.outer_mm) / 2,
        needle.cone_mm or 0.0,
        needle.length_mm,
        needle.hub_outer_mm / 2 if needle.hub_outer_mm else None,
        clearance_mm=clearance_mm,
    )
