"""Move a part's toolpath to its well of a plate, with a raised travel from the last part."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from design.errors import ToolpathError
from design.toolpath.moves import MoveBuilder
from design.toolpath.toolpath import MoveKind, Toolpath, join_toolpaths
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class Trip:
    """How a needle goes from one part to the next.

    Attributes
    ----------
    over_mm : float, mm
        Height, in the frame of the ends it joins, from which it is clear of all that stands.
    speed_mm_s : float, mm/s
    relieve_ul : float, µL
        Drawn back before it leaves, and pushed out where it arrives.
    plunger_ul_s : float, µL/s
    """

    over_mm: float
    speed_mm_s: float
    relieve_ul: float
    plunger_ul_s: float


def place_in_well(
    toolpath: Toolpath, place_mm: FloatArray, doses: float = 1.0, source: int = 0
) -> Toolpath:
    """The toolpath moved by ``place_mm`` (3,), its volumes times ``doses``.

    ``source`` is added to the number of each vessel, so that those of several parts differ.
    """
    return replace(
        toolpath,
        start=toolpath.start + place_mm,
        end=toolpath.end + place_mm,
        volume_ul=toolpath.volume_ul * doses,
        source=np.where(toolpath.source >= 0, toolpath.source + source, toolpath.source),
    )


def with_approach(toolpath: Toolpath, from_mm: FloatArray, trip: Trip) -> tuple[Toolpath, int]:
    """The toolpath with the way to it in front, and of how many moves that is.

    Relieve, straight up, across, straight down, and push out again what was relieved; at the top
    stands a point where the syringe may be changed.

    Raises
    ------
    ToolpathError
        When the way's height lies below one of its ends.
    """
    to_mm = toolpath.start[0]
    if trip.over_mm < max(from_mm[2], to_mm[2]):
        raise ToolpathError(
            f"the way between two parts is at {trip.over_mm:g} mm and begins or ends at "
            f"{max(from_mm[2], to_mm[2]):g} mm; go higher"
        )
    moves = MoveBuilder(from_mm, toolpath.source_kind, toolpath.layer_height_mm)
    moves.plunge(-trip.relieve_ul, trip.plunger_ul_s, -1)
    up, across = from_mm.copy(), to_mm.copy()
    up[2] = across[2] = trip.over_mm
    moves.travel(up[None], trip.speed_mm_s, -1)
    moves.travel(np.stack([across, to_mm]), trip.speed_mm_s, -1)
    moves.plunge(trip.relieve_ul, trip.plunger_ul_s, -1)
    way = moves.build(must_write=False)
    return join_toolpaths([way, toolpath]), len(way)


def written_ul(toolpath: Toolpath) -> float:
    """Ink of its writing moves alone, µL."""
    return float(toolpath.volume_ul[toolpath.kind == MoveKind.WRITE].sum())
