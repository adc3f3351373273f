"""Make priming moves before the part: purge over a waste cup, wipe, line in the bath.

A syringe just mounted holds a bubble at its outlet, and its ink begins to flow late: a line beside
the part takes both. Nothing of it touches the part.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from design.errors import ToolpathError
from design.toolpath.moves import MoveBuilder
from design.toolpath.toolpath import Toolpath, require_not_negative, require_positive
from kernels.arrays import FloatArray

NOTHING = -1
"""Source of these moves: no layer, no vessel."""


@dataclass(frozen=True)
class Purge:
    """Ink pushed out over a waste cup.

    Attributes
    ----------
    place_mm : (3,) float64, mm
        Where the tip stands, part's frame.
    volume_ul : float, µL
    wipe_mm : (3,) float64 or None, mm
        Where it goes then, straight, along a wiper.
    """

    place_mm: FloatArray
    volume_ul: float
    wipe_mm: FloatArray | None = None


@dataclass(frozen=True)
class PrimeLine:
    """Prime line in the bath beside the part.

    Attributes
    ----------
    length_mm, gap_mm : float, mm
        Its length, and how far beside the part's bounds its axis lies.
    area_mm2 : float, mm²
        Cross-section.
    speed_mm_s : float, mm/s
    """

    length_mm: float
    gap_mm: float
    area_mm2: float
    speed_mm_s: float

    def __post_init__(self) -> None:
        require_positive("prime line", **vars(self))


@dataclass(frozen=True)
class HeadPriming:
    """What one head does, and its plunger's relief (µL), flow (µL/s) and wait for the ink (s)."""

    retract_ul: float
    plunger_ul_s: float
    purge: Purge | None = None
    line: PrimeLine | None = None
    dwell_s: float = 0.0

    def __post_init__(self) -> None:
        require_positive("priming", plunger_ul_s=self.plunger_ul_s)
        require_not_negative("priming", retract_ul=self.retract_ul, dwell_s=self.dwell_s)


@dataclass(frozen=True)
class Surroundings:
    """Bath and part beside which priming takes place.

    Attributes
    ----------
    bounds_mm : (2, 3) float64, mm
        Lowest and highest corner of the part, in whose frame all is.
    safe_mm : float, mm
        Height of travels: above the part, and the dish's wall where there is one.
    travel_speed_mm_s, lift_speed_mm_s : float, mm/s
    """

    bounds_mm: FloatArray
    safe_mm: float
    travel_speed_mm_s: float
    lift_speed_mm_s: float


def priming(
    first_mm: ArrayLike,
    tool: int,
    heads: Sequence[HeadPriming],
    around: Surroundings,
    like: Toolpath,
) -> Toolpath:
    """Moves that come before ``like`` and end where it begins.

    The head that begins the part comes last. The lines of several lie side by side, a gap apart.

    Parameters
    ----------
    first_mm : (3,) array, mm
        Where the part's path begins.
    tool : int
        The head that begins it.
    heads : sequence of HeadPriming
        Of each head.
    around : Surroundings
    like : Toolpath
        The part's own path, or its first part.

    Raises
    ------
    ToolpathError
        When no head does anything, or the part begins above the height of travels.
    """
    first = np.asarray(first_mm, dtype=np.float64)
    if first[2] > around.safe_mm:
        raise ToolpathError(
            f"the part begins at {first[2]:g} mm, above the {around.safe_mm:g} mm at which the "
            "needle comes from priming (part's frame)"
        )
    order = [number for number in range(len(heads)) if number != tool] + [tool]
    primer = _Primer(first, around, like)
    for place, number in enumerate(order):
        primer.prime(number, heads[number], place)
    return primer.finish(tool, heads[tool])


class _Primer:
    def __init__(self, first: FloatArray, around: Surroundings, like: Toolpath) -> None:
        self._first, self._around, self._like = first, around, like
        self._builder: MoveBuilder | None = None
        self._tool = 0

    def prime(self, tool: int, head: HeadPriming, place: int) -> None:
        """Purge, wipe and line of one head."""
        self._tool = tool
        if head.purge is not None:
            self._purge(head.purge, head)
        if head.line is not None:
            self._line(head.line, head, place)

    def finish(self, tool: int, head: HeadPriming) -> Toolpath:
        """Relieve, go to the part, and prime there."""
        builder = self._builder
        if builder is None:
            raise ToolpathError("priming: no head purges or writes a line; leave it out")
        self._tool = tool
        if head.line is not None:
            builder.plunge(-head.retract_ul, head.plunger_ul_s, NOTHING)
        self._go(self._first)
        if head.line is not None or head.purge is not None:
            builder.plunge(head.retract_ul, head.plunger_ul_s, NOTHING)
        return builder.build(must_write=False)

    def _purge(self, purge: Purge, head: HeadPriming) -> None:
        builder = self._go(purge.place_mm)
        builder.plunge(purge.volume_ul, head.plunger_ul_s, NOTHING)
        builder.plunge(-head.retract_ul, head.plunger_ul_s, NOTHING)
        if purge.wipe_mm is not None:
            builder.travel(purge.wipe_mm[None], self._around.lift_speed_mm_s, NOTHING)

    def _line(self, line: PrimeLine, head: HeadPriming, place: int) -> None:
        """A change of heads relieves the old one itself, and primes it when it comes back."""
        start, end = line_beside_bounds(self._around.bounds_mm, self._first, line, place)
        builder = self._go(start)
        if head.purge is not None:
            builder.plunge(head.retract_ul, head.plunger_ul_s, NOTHING)
        builder.dwell(head.dwell_s, NOTHING)
        volume = np.array([line.area_mm2 * line.length_mm])
        builder.write(end[None], volume, line.speed_mm_s, NOTHING)

    def _go(self, to: FloatArray) -> MoveBuilder:
        """Up to the safe height, across, down; the job begins at the first place."""
        builder, around = self._builder, self._around
        if builder is None:
            like = self._like
            builder = MoveBuilder(to, like.source_kind, like.layer_height_mm)
            self._builder = builder
        else:
            tip, safe = builder.tip, around.safe_mm
            up, over = np.array([*tip[:2], safe]), np.array([*to[:2], safe])
            builder.travel(up[None], around.lift_speed_mm_s, NOTHING)
            builder.tool = self._tool
            builder.travel(over[None], around.travel_speed_mm_s, NOTHING)
            builder.travel(to[None], around.lift_speed_mm_s, NOTHING)
        builder.tool = self._tool
        return builder


def line_beside_bounds(
    bounds_mm: FloatArray, first_mm: FloatArray, line: PrimeLine, place: int = 0
) -> tuple[FloatArray, FloatArray]:
    """Ends, (3,) each, of a line beside the side of the bounds that is nearest the first point.

    It lies as high as that point, and ends beside it as nearly as the side's length allows;
    ``place`` counts further gaps outward.
    """
    low, high = bounds_mm[0, :2], bounds_mm[1, :2]
    away = np.concatenate([first_mm[:2] - low, high - first_mm[:2]])
    side = int(away.argmin())
    across, along, gap = side % 2, 1 - side % 2, line.gap_mm * (place + 1)
    end = np.array(first_mm, dtype=np.float64)
    end[across] = low[across] - gap if side < len(low) else high[across] + gap
    middle = (low[along] + high[along]) / 2
    way = math.copysign(line.length_mm, end[along] - middle)
    start = end.copy()
    start[along] -= way
    return start, end
