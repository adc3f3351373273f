"""The needle's shaft against what an embedded job has written: run the checker, and judge it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Needle, Printer, ProfileError, steady_flow
from printctl.preflight.shaft_map import Written
from printctl.set_up import Loaded
from printctl.set_up.check import Check
from sim.clearance import Clearance, NeedleBody, ShaftContact, check_clearance, motion_of
from sim.dryrun import DryRun
from sim.gcode_modal import MOVE

FloatArray = NDArray[np.float64]


def shaft_clearance(
    run: DryRun, printer: Printer, loads: Sequence[Loaded], written: Written
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


def volumes(run: DryRun, printer: Printer, loads: Sequence[Loaded]) -> FloatArray:
    """What comes out of the head in use in each row of the program, (rows,), µL.

    Of a pneumatic head whose needle nobody named, at whose flow one can only guess, the ink's
    lines have no thickness.
    """
    program = run.program
    if printer.pneumatic is None:
        bore = [np.pi / 4 * one.syringe.inner_mm**2 * one.ink.flow_factor for one in loads]
        return np.asarray(program.pushed * np.array(bore)[program.tool])
    needle = loads[0].needle
    flow = steady_flow(printer.pneumatic, loads[0].ink, needle).ul_s if needle else 0.0
    ends = np.vstack([program.start[None, :3], program.target[:, :3]])
    length = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    lasts = np.divide(length, program.feed, out=np.zeros(len(length)), where=program.feed > 0)
    return np.where(run.doses & (program.kind == MOVE), flow * lasts, 0.0)


def written_ul(run: DryRun, printer: Printer, loads: Sequence[Loaded]) -> float:
    """What comes out of all heads in the whole run, µL; nothing where the pressure moves no ink."""
    try:
        return float(volumes(run, printer, loads).sum())
    except ProfileError:  # said by a check of its own
        return 0.0


def shaft_checks(found: Clearance, allowed: int, *, accepted: bool = False) -> list[Check]:
    """Whether the shaft passes through nothing but joints, and keeps its clearance.

    Parameters
    ----------
    found : Clearance
    allowed : int
        Pairs of vessels, one being written and one crossed. So many are told, more refuse.
    accepted : bool
        Whether the user takes all of them: they are told.
    """
    taken = accepted or found.pairs <= allowed
    crossing = Check(
        "vessels that the needle's shaft passes through",
        found.pairs,
        allowed,
        "",
        not found.crossings,
        f"line {found.crossings[0].line}" if found.crossings else "",
        _worst(found.crossings, "cross")
        + "use a thinner needle or a sparser network, leave such vessels out (toolpath.leave_out "
        "in a recipe), or accept them: --accept-crossings of `printctl print`, "
        "toolpath.allowed_crossings in a recipe",
        "warns" if taken else "refuses",
    )
    graze = Check(
        f"vessels that the shaft passes by nearer than {found.clearance_mm:g} mm",
        found.grazed_pairs,
        0,
        "",
        not found.grazes,
        f"line {found.grazes[0].line}" if found.grazes else "",
        _worst(found.grazes, "come so near") + "the needle must be straight and well calibrated",
        "warns",
    )
    return [crossing, graze]


def _worst(found: Sequence[ShaftContact], do: str) -> str:
    if not found:
        return ""
    more = f"; {len(found)} moves {do} in all" if len(found) > 1 else ""
    return f"{found[0].sentence()}{more}; "


def shaft_lines(facts: Mapping[str, Any]) -> list[str]:
    """For people, from `Clearance.as_dict`."""
    near = facts["nearest_apart_mm"]
    told = "nothing within 1 mm" if near is None else f"{near:.3f} mm at the nearest"
    lines = [
        f"needle's shaft: {facts['moves']} moves looked at, {facts['crossed_pairs']} vessels "
        f"crossed; to vessels without a joint {told}"
    ]
    if facts["own_overlaps"]:
        worst = facts["overlap"][0]
        lines.append(
            f"the network overlaps itself: {facts['own_overlaps']} pairs of vessels, the deepest "
            f"{worst['overlap_mm']:.3f} mm (vessels {worst['vessel']} and {worst['other']}); they "
            "become one body there, and the shaft passes as through a joint"
        )
    return lines


def unmapped_check() -> Check:
    """Embedded writing without a map: nobody can tell joints from crossings."""
    return Check(
        "needle's shaft against what is written",
        0,
        0,
        "",
        False,
        "FILE.map.npz",
        "not beside the file, so whether the shaft passes through written vessels wasn't looked at",
        "warns",
    )


def accepted_text(found: Clearance) -> str:
    """What a journal is to keep of crossings that a user accepted; empty without any."""
    if not found.crossings:
        return ""
    return (
        f"{len(found.crossings)} moves that cross {found.pairs} pairs of vessels; worst: "
        f"{found.crossings[0].sentence()}"
    )
