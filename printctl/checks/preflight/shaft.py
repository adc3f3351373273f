"""Check a G-code file for collisions of the needle's shaft with written ink."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from design.network import VesselNetwork
from design.toolpath import MoveKind
from firmware_profiles import Needle, Printer
from gcode.clearance.check import Clearance, check_clearance
from gcode.clearance.kernels import NeedleBody
from gcode.clearance.motion import LineSources, motion_of
from gcode.clearance.network import WrittenNetwork
from gcode.dry_run.run import DryRun
from kernels.arrays import FloatArray
from printctl.checks.kinds import Kind
from printctl.checks.preflight.ink import volumes
from printctl.checks.set_up import Check, HeadLoading, SetUp, finding, none_of
from printctl.errors import UsageError

if TYPE_CHECKING:
    from gcode.clearance.check import ShaftContact


_REMEDY: Final = (
    "use a thinner needle or a sparser network, omit these vessels (toolpath.leave_out in a "
    "recipe), or accept them: --accept-crossings of `printctl print`, toolpath.allowed_crossings "
    "in a recipe"
)
_ACCEPTED: Final = "accepted; inspect these vessels in the scan"


def shaft_checks(clearance: Clearance, allowed: int, *, accepted: bool = False) -> list[Check]:
    """Whether the shaft passes through nothing but joints, and keeps its clearance.

    Parameters
    ----------
    clearance : Clearance
    allowed : int
        Pairs of vessels, one being written and one crossed. So many are told, more refuse.
    accepted : bool
        Whether the user takes all of them: they are told.
    """
    taken = accepted or clearance.pairs <= allowed
    crossing = Check(
        Kind.SHAFT_CROSSING,
        "vessels crossed by the needle shaft",
        clearance.pairs,
        allowed,
        "",
        not clearance.crossings,
        f"line {clearance.crossings[0].line}" if clearance.crossings else "",
        _worst(clearance.crossings, "cross") + (_ACCEPTED if taken else _REMEDY),
        "warns" if taken else "refuses",
    )
    graze = none_of(
        Kind.SHAFT_NEAR,
        f"vessels within {clearance.clearance_mm:g} mm of the needle shaft",
        clearance.grazed_pairs,
        f"line {clearance.grazes[0].line}" if clearance.grazes else "",
        _worst(clearance.grazes, "come this close")
        + "the needle must be straight and well calibrated",
        "warns",
    )
    return [crossing, graze]


def _worst(contacts: Sequence[ShaftContact], do: str) -> str:
    if not contacts:
        return ""
    more = f"; {len(contacts)} moves {do} in total" if len(contacts) > 1 else ""
    return f"{contacts[0].sentence()}{more}; "


def shaft_lines(facts: Mapping[str, Any]) -> list[str]:
    """For people, from `Clearance.as_dict`."""
    near = facts["nearest_apart_mm"]
    nearest = "nothing within 1 mm" if near is None else f"closest {near:.3f} mm"
    lines = [
        f"needle shaft: {facts['moves']} moves checked, {facts['crossed_pairs']} vessels crossed; "
        f"to unconnected vessels {nearest}"
    ]
    if facts["own_overlaps"]:
        worst = facts["overlap"][0]
        lines.append(
            f"the network overlaps itself: {facts['own_overlaps']} pairs of vessels, the deepest "
            f"{worst['overlap_mm']:.3f} mm (vessels {worst['vessel']} and {worst['other']}); they "
            "merge there, which is treated as a joint"
        )
    return lines


def unmapped_check() -> Check:
    """Embedded writing without a map: nobody can tell joints from crossings."""
    return finding(
        Kind.SHAFT_UNMAPPED,
        "needle shaft vs. printed vessels",
        "FILE.map.npz",
        "not found next to the file, so collisions of the shaft with printed vessels weren't "
        "checked",
        "warns",
    )


def accepted_text(clearance: Clearance) -> str:
    """What a journal is to keep of crossings that a user accepted; empty without any."""
    if not clearance.crossings:
        return ""
    return (
        f"{len(clearance.crossings)} moves that cross {clearance.pairs} pairs of vessels; worst: "
        f"{clearance.crossings[0].sentence()}"
    )


_NETWORK = ("nodes", "vessel_nodes", "offset", "points", "radius")


@dataclass(frozen=True)
class ShaftMap:
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
    needles_mm : (heads, 3) float64, mm
        For which it was planned: outer diameter of the shaft and of the tip, height of the cone
        between them.
    """

    sources: LineSources
    network: WrittenNetwork
    overlap_radii: float
    clearance_mm: float
    needles_mm: FloatArray


def written_arrays(
    network: VesselNetwork,
    place_mm: FloatArray,
    overlap_radii: float,
    clearance_mm: float,
    needles_mm: Sequence[tuple[float, float, float]],
    bundled: NDArray[np.bool_] | None = None,
) -> dict[str, NDArray[Any]]:
    """What the map of an embedded job is to hold, so that its file can be checked by itself.

    Parameters
    ----------
    network : VesselNetwork
        As it is written, in the part's frame.
    place_mm : (3,) float64, mm
        From there to the printer's.
    overlap_radii, clearance_mm, needles_mm
        As in `ShaftMap`.
    bundled : (v,) bool or None
        Vessels written as several strands.
    """
    return {
        **({} if bundled is None else {"bundled": bundled}),
        **{f"network_{name}": getattr(network, name) for name in _NETWORK},
        "place_mm": np.asarray(place_mm, dtype=np.float64),
        "overlap_radii": np.array(overlap_radii),
        "clearance_mm": np.array(clearance_mm),
        "needles_mm": np.asarray(needles_mm, dtype=np.float64),
    }


def read_written(path: Path) -> ShaftMap | None:
    """Read the map of an embedded job; None where it is of layers, or there is none.

    Raises
    ------
    UsageError
        When the file can't be read, or is of vessels and doesn't say which network they are of.
    """
    if not path.is_file():
        return None
    try:
        with np.load(path, allow_pickle=False) as arrays_file:
            data = {name: arrays_file[name] for name in arrays_file.files}
        if str(data["source_kind"]) != "vessel":
            return None
        return read_written_arrays(data)
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as exc:
        raise UsageError(
            f"{path} doesn't contain what the job prints ({exc}), so the needle shaft can't be "
            "checked; generate the G-code and its map again with `printctl toolpath`"
        ) from exc


def read_written_arrays(data: Mapping[str, NDArray[Any]]) -> ShaftMap:
    """What the arrays of a map say: ``source`` and ``kind`` of each line, and `written_arrays`."""
    arrays = {name: data[f"network_{name}"] for name in _NETWORK}
    network = WrittenNetwork(**arrays, bundled=data.get("bundled"))
    writes = data["kind"] == MoveKind.WRITE
    return ShaftMap(
        LineSources(data["source"].astype(np.int64), writes),
        network.moved(data["place_mm"]),
        float(data["overlap_radii"]),
        float(data["clearance_mm"]),
        data["needles_mm"].astype(np.float64),
    )


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


_LEVEL_MM = 1e-3


@dataclass(frozen=True)
class FileShaft:
    """What the checker says of a file.

    Attributes
    ----------
    checks : list of Check
        None for a file of layers.
    found : Clearance or None
        None where it wasn't looked at.
    accepted : tuple of str
        What the user took, for the journal.
    """

    checks: list[Check]
    found: Clearance | None = None
    accepted: tuple[str, ...] = ()

    def facts(self) -> dict[str, Any]:
        """JSON-ready."""
        return {} if self.found is None else {"clearance": self.found.as_dict()}

    def lines(self) -> list[str]:
        """For people."""
        return [] if self.found is None else shaft_lines(self.found.as_dict())


def file_shaft(
    file: Path, run: DryRun, mounted: SetUp, *, allowed: int = 0, accepted: bool = False
) -> FileShaft:
    """Check a file's shaft.

    Parameters
    ----------
    file : Path
        Its map, ``FILE.map.npz``, stands beside it.
    run : DryRun
    mounted : SetUp
    allowed : int
        Crossings that the recipe takes, as of `shaft_checks`.
    accepted : bool
        Whether the user prints with any.

    Raises
    ------
    UsageError
        For a map that can't be read, or of another file.
    """
    path = file.with_suffix(".map.npz")
    if not path.is_file():
        return FileShaft([unmapped_check()] if _climbs(run) else [])
    written = read_written(path)
    if written is None:
        return FileShaft([])
    _check_lines(file, path, len(written.sources.vessel))
    clearance = shaft_clearance(run, mounted.printer, mounted.loads, written)
    text, taken = accepted_text(clearance), accepted or clearance.pairs <= allowed
    return FileShaft(
        shaft_checks(clearance, allowed, accepted=accepted),
        clearance,
        (text,) if taken and text else (),
    )


def _check_lines(file: Path, path: Path, mapped: int) -> None:
    data = file.read_bytes()
    lines = data.count(b"\n") + (not data.endswith(b"\n"))
    if lines != mapped:
        raise UsageError(
            f"{path.name} maps a file of {mapped} lines, but {file.name} has {lines}: it belongs "
            "to another job, so the needle shaft can't be checked; generate both again with "
            "`printctl toolpath`, or move the map away"
        )


def _climbs(run: DryRun) -> bool:
    """Whether ink is pushed on the way up or down, as no layer does it."""
    height = np.diff(run.program.target[:, 2], prepend=run.program.start[2])
    return bool((run.doses & (np.abs(height) > _LEVEL_MM)).any())
