"""Convert collisions of the needle's shaft with written ink to preflight check results and text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from printctl.checks.set_up.check import Check

if TYPE_CHECKING:
    from sim.gcode.clearance import Clearance, ShaftContact


_REMEDY: Final = (
    "use a thinner needle or a sparser network, leave such vessels out (toolpath.leave_out in a "
    "recipe), or accept them: --accept-crossings of `printctl print`, toolpath.allowed_crossings "
    "in a recipe"
)
_ACCEPTED: Final = "accepted, so the print goes on; look at these vessels in the scan"


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
        "vessels that the needle's shaft passes through",
        clearance.pairs,
        allowed,
        "",
        not clearance.crossings,
        f"line {clearance.crossings[0].line}" if clearance.crossings else "",
        _worst(clearance.crossings, "cross") + (_ACCEPTED if taken else _REMEDY),
        "warns" if taken else "refuses",
    )
    graze = Check(
        f"vessels that the shaft passes by nearer than {clearance.clearance_mm:g} mm",
        clearance.grazed_pairs,
        0,
        "",
        not clearance.grazes,
        f"line {clearance.grazes[0].line}" if clearance.grazes else "",
        _worst(clearance.grazes, "come so near")
        + "the needle must be straight and well calibrated",
        "warns",
    )
    return [crossing, graze]


def _worst(contacts: Sequence[ShaftContact], do: str) -> str:
    if not contacts:
        return ""
    more = f"; {len(contacts)} moves {do} in all" if len(contacts) > 1 else ""
    return f"{contacts[0].sentence()}{more}; "


def shaft_lines(facts: Mapping[str, Any]) -> list[str]:
    """For people, from `Clearance.as_dict`."""
    near = facts["nearest_apart_mm"]
    nearest = "nothing within 1 mm" if near is None else f"{near:.3f} mm at the nearest"
    lines = [
        f"needle's shaft: {facts['moves']} moves looked at, {facts['crossed_pairs']} vessels "
        f"crossed; to vessels without a joint {nearest}"
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


def accepted_text(clearance: Clearance) -> str:
    """What a journal is to keep of crossings that a user accepted; empty without any."""
    if not clearance.crossings:
        return ""
    return (
        f"{len(clearance.crossings)} moves that cross {clearance.pairs} pairs of vessels; worst: "
        f"{clearance.crossings[0].sentence()}"
    )
