"""The needle's shaft against what an embedded job has written: run the checker, and judge it."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.network import VesselNetwork
from design.toolpath import MoveKind
from firmware_profiles import Needle, Printer, steady_flow
from printctl.errors import UsageError
from printctl.preflight.check import Check
from printctl.preflight.head_checks import Loaded
from sim.clearance import (
    Clearance,
    LineSources,
    NeedleBody,
    WrittenNetwork,
    check_clearance,
    motion_of,
)
from sim.dryrun import DryRun
from sim.gcode_modal import MOVE

FloatArray = NDArray[np.float64]
_NETWORK = ("nodes", "vessel_nodes", "offset", "points", "radius")


@dataclass(frozen=True)
class Written:
    """What an embedded job's map says besides its lines.

    Attributes
    ----------
    sources : LineSources
    network : WrittenNetwork
        In the printer's frame.
    overlap_radii : float
        Of joints.
    clearance_mm : float, mm
        That the plan keeps.
    needle_outer_mm : (heads,) float64, mm
        Outer diameters for which it was planned.
    """

    sources: LineSources
    network: WrittenNetwork
    overlap_radii: float
    clearance_mm: float
    needle_outer_mm: FloatArray


def written_arrays(
    network: VesselNetwork,
    place_mm: FloatArray,
    overlap_radii: float,
    clearance_mm: float,
    needle_outer_mm: Sequence[float],
) -> dict[str, NDArray[Any]]:
    """What the map of an embedded job is to hold, so that its file can be checked by itself.

    Parameters
    ----------
    network : VesselNetwork
        As it is written, in the part's frame.
    place_mm : (3,) float64, mm
        From there to the printer's.
    overlap_radii, clearance_mm, needle_outer_mm
        As in `Written`.
    """
    return {
        **{f"network_{name}": getattr(network, name) for name in _NETWORK},
        "place_mm": np.asarray(place_mm, dtype=np.float64),
        "overlap_radii": np.array(overlap_radii),
        "clearance_mm": np.array(clearance_mm),
        "needle_outer_mm": np.asarray(needle_outer_mm, dtype=np.float64),
    }


def read_written(path: Path) -> Written | None:
    """Read the map of an embedded job; None where it is of layers, or there is none.

    Raises
    ------
    UsageError
        When the file can't be read, or is of vessels and doesn't say which network they are of.
    """
    if not path.is_file():
        return None
    try:
        with np.load(path, allow_pickle=False) as found:
            data = {name: found[name] for name in found.files}
        if str(data["source_kind"]) != "vessel":
            return None
        return _written(data)
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as exc:
        raise UsageError(
            f"{path} doesn't say what the job writes ({exc}), so the needle's shaft can't be "
            "checked; write the G-code and its map anew with `printctl toolpath`"
        ) from exc


def _written(data: Mapping[str, NDArray[Any]]) -> Written:
    network = WrittenNetwork(*(data[f"network_{name}"] for name in _NETWORK))
    writes = data["kind"] == MoveKind.WRITE
    return Written(
        LineSources(data["source"].astype(np.int64), writes),
        network.moved(data["place_mm"]),
        float(data["overlap_radii"]),
        float(data["clearance_mm"]),
        data["needle_outer_mm"].astype(np.float64),
    )


def shaft_clearance(
    run: DryRun, printer: Printer, loads: Sequence[Loaded], written: Written
) -> Clearance:
    """Check every move of a run; a head whose needle nobody named has the one planned for.

    Raises
    ------
    ClearanceError
        When map and G-code aren't of one job.
    """
    planned = written.needle_outer_mm
    bodies = [
        _body(load.needle, float(planned[min(k, len(planned) - 1)]), written.clearance_mm)
        for k, load in enumerate(loads)
    ]
    motion = motion_of(run, written.sources, volumes(run, printer, loads))
    return check_clearance(motion, written.network, bodies, written.overlap_radii)


def _body(needle: Needle | None, planned_mm: float, clearance_mm: float) -> NeedleBody:
    if needle is None:
        return NeedleBody(planned_mm / 2, clearance_mm=clearance_mm)
    return NeedleBody(needle.outer_mm / 2, length_mm=needle.length_mm, clearance_mm=clearance_mm)


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


def shaft_check(found: Clearance, allowed: int, *, accepted: bool = False) -> Check:
    """Whether the shaft passes through nothing but joints, or no more than is allowed.

    Parameters
    ----------
    found : Clearance
    allowed : int
        Pairs of vessels, one being written and one crossed.
    accepted : bool
        Whether the user takes all of them: they warn.
    """
    more = f"; {len(found.crossings)} moves cross in all" if len(found.crossings) > 1 else ""
    worst = found.crossings[0].sentence() + more + "; " if found.crossings else ""
    return Check(
        "vessels that the needle's shaft passes through",
        found.pairs,
        allowed,
        "",
        found.pairs <= allowed,
        f"line {found.crossings[0].line}" if found.crossings else "toolpath.allowed_crossings",
        f"{worst}use a thinner needle or a sparser network, or accept them: --accept-crossings of "
        "`printctl print`, toolpath.allowed_crossings in a recipe",
        "warns" if accepted else "refuses",
    )


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
