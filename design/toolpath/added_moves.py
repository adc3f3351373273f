"""Make priming moves before the part: purge over a waste cup, wipe, line in the bath.

A syringe just mounted holds a bubble at its outlet, and its ink begins to flow late: a line beside
the part takes both. Nothing of it touches the part.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from design.errors import ToolpathError
from design.toolpath.toolpath import (
    MoveBuilder,
    MoveKind,
    Toolpath,
    check_fields,
    join_toolpaths,
    require_positive,
)
from kernels.arrays import BoolArray, FloatArray, IntArray

NO_SOURCE: Final = -1
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
    """Priming of one head; its plunger's relief (µL), flow (µL/s) and wait for the ink (s)."""

    retract_ul: float
    plunger_ul_s: float
    purge: Purge | None = None
    line: PrimeLine | None = None
    dwell_s: float = 0.0

    def __post_init__(self) -> None:
        check_fields("priming", self, "plunger_ul_s", "retract_ul dwell_s")


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
            builder.plunge(-head.retract_ul, head.plunger_ul_s, NO_SOURCE)
        self._go(self._first)
        if head.line is not None or head.purge is not None:
            builder.plunge(head.retract_ul, head.plunger_ul_s, NO_SOURCE)
        return builder.build(must_write=False)

    def _purge(self, purge: Purge, head: HeadPriming) -> None:
        builder = self._go(purge.place_mm)
        builder.plunge(purge.volume_ul, head.plunger_ul_s, NO_SOURCE)
        builder.plunge(-head.retract_ul, head.plunger_ul_s, NO_SOURCE)
        if purge.wipe_mm is not None:
            builder.travel(purge.wipe_mm[None], self._around.lift_speed_mm_s, NO_SOURCE)

    def _line(self, line: PrimeLine, head: HeadPriming, place: int) -> None:
        """A change of heads relieves the old one itself, and primes it when it comes back."""
        start, end = line_beside_bounds(self._around.bounds_mm, self._first, line, place)
        builder = self._go(start)
        if head.purge is not None:
            builder.plunge(head.retract_ul, head.plunger_ul_s, NO_SOURCE)
        builder.dwell(head.dwell_s, NO_SOURCE)
        volume = np.array([line.area_mm2 * line.length_mm])
        builder.write(end[None], volume, line.speed_mm_s, NO_SOURCE)

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
            builder.travel(up[None], around.lift_speed_mm_s, NO_SOURCE)
            builder.tool = self._tool
            builder.travel(over[None], around.travel_speed_mm_s, NO_SOURCE)
            builder.travel(to[None], around.lift_speed_mm_s, NO_SOURCE)
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


class _LagLimits(NamedTuple):
    """How moves are cut to compensate a lag.

    For a linear ink τ dQ/dt = Q_in − Q (`docs/calibration.md`), so the required flow Q of a path
    comes out if the plunger pushes Q + τ dQ/dt. Over a move of volume V that is V + τ (Q₁ − Q₀), Q₀
    and Q₁ the required flows at its ends; what is added over a whole stroke cancels but for the
    pressure that the needle must have at its beginning and loses at its end, τ Q each. These two
    are pushed and taken back while the needle stands, as fast as the plunger may, and so is a step
    of flow on the way: at a rate r it takes t = τ ln((r − Q₀)/(r − Q₁)) to raise the flow, τ ln((r
    + Q₀)/(r + Q₁)) to lower it.

    The plunger never goes back while the needle writes: where the required flow falls faster than
    the pressure can, e^(−t/τ), it stands, and what is still too much is taken off the following
    moves.
    """

    moves: int = 8  # in a time constant where the flow changes
    shortest_mm: float = 0.15  # shorter ones aren't made: a plunger's step is of that order
    same: float = 0.01  # neighbours' flows that differ by less of the larger need no more moves
    step: float = 0.2  # a change by so much of the larger is made while the needle stands
    rate_share: float = (
        0.9  # of the plunger's rate: above, pressure would take ever longer to build
    )


LAG: Final = _LagLimits()


@dataclass(frozen=True)
class AdvancedToolpath:
    """A toolpath whose plunger is driven ahead.

    Attributes
    ----------
    toolpath : Toolpath
    lag_s : float, s
    stood_ul : float, µL
        What the plunger couldn't take back at once, because it never goes back while writing.
    """

    toolpath: Toolpath
    lag_s: float
    stood_ul: float


def compensate_lag(toolpath: Toolpath, lag_s: float, rate_ul_s: float) -> AdvancedToolpath:
    """Compensate a lag along all strokes (runs of writing moves of one head).

    Parameters
    ----------
    toolpath : Toolpath
    lag_s : float, s
        τ.
    rate_ul_s : float, µL/s
        At which the plunger builds and takes back pressure while the needle stands.
    """
    require_positive("lag compensation", lag_s=lag_s, rate_ul_s=rate_ul_s)
    fine = _divided(toolpath, lag_s)
    flow, volume, stood = _flow(fine), fine.volume_ul.copy(), 0.0
    first, last, joined = _runs(fine, flow)
    begins, ends = np.zeros(len(first)), np.zeros(len(first))
    for number, (begin, end) in enumerate(zip(first, last + 1, strict=True)):
        at = _at_ends(flow[begin:end], volume[begin:end])
        volume[begin:end], late = _forward(volume[begin:end], lag_s * np.diff(at))
        stood += late
        begins[number], ends[number] = at[0], at[-1]
    # What flows before each run, and after it: nothing, but where the next one goes on at once.
    before = np.where(joined, np.concatenate([[0.0], ends[:-1]]), 0.0)
    stops = np.append(~joined[1:], True)
    stands = _Stands(
        np.concatenate([last[stops] + 1, first]),
        np.concatenate([last[stops], first]),
        np.concatenate([fine.end[last[stops]], fine.start[first]]),
        _pushed_s(
            np.concatenate([ends[stops], before]),
            np.concatenate([np.zeros(int(stops.sum())), begins]),
            lag_s,
            rate_ul_s,
        ),
    )
    changed = replace(fine, volume_ul=volume)
    return AdvancedToolpath(_with_stands(changed, stands, rate_ul_s), lag_s, stood)


@dataclass(frozen=True)
class _Stands:
    """Where the needle stands for the plunger: before which row, like which, where, how long.

    A time below 0 draws the plunger back.
    """

    at: IntArray
    row: IntArray
    place: FloatArray
    lasts_s: FloatArray


def _runs(toolpath: Toolpath, flow: FloatArray) -> tuple[IntArray, IntArray, BoolArray]:
    """First and last move of each run without a step of flow, and which follow another at once."""
    writes = toolpath.kind == MoveKind.WRITE
    follows = writes[1:] & writes[:-1] & (toolpath.tool[1:] == toolpath.tool[:-1])
    steps = np.abs(np.diff(flow)) > LAG.step * np.maximum(flow[1:], flow[:-1])
    within = follows & ~steps
    first = np.flatnonzero(writes & ~np.concatenate([[False], within]))
    last = np.flatnonzero(writes & ~np.concatenate([within, [False]]))
    return first, last, np.concatenate([[False], follows])[first]


def _flow(toolpath: Toolpath) -> FloatArray:
    """Asked for in each move, µL/s; 0 where the needle stands."""
    speed, length = toolpath.speed_mm_s, toolpath.lengths
    per_mm = np.divide(toolpath.volume_ul, length, out=np.zeros(len(length)), where=length > 0)
    return per_mm * speed


def _at_ends(flow: FloatArray, volume: FloatArray) -> FloatArray:
    """Flow at the ends of a run's moves, (n + 1,): between neighbours by their times."""
    lasts = volume / np.maximum(flow, 1e-12)
    both = np.maximum(lasts[1:] + lasts[:-1], 1e-12)
    inner = (flow[:-1] * lasts[1:] + flow[1:] * lasts[:-1]) / both
    return np.concatenate([flow[:1], inner, flow[-1:]])


def _forward(volume: FloatArray, added: FloatArray) -> tuple[FloatArray, float]:
    """Add to each move's volume, clipped at 0; return the volumes and the most carried on."""
    wanted = volume + added
    if (wanted >= 0).all():
        return wanted, 0.0
    volumes, owed, late = np.zeros(len(wanted)), 0.0, 0.0
    for k, value in enumerate(wanted):
        volumes[k] = max(value + owed, 0.0)
        owed = min(value + owed, 0.0)
        late = max(late, -owed)
    return volumes, late


def _pushed_s(before: FloatArray, after: FloatArray, lag_s: float, rate_ul_s: float) -> FloatArray:
    """How long the plunger pushes, or draws (below 0), to bring one flow to another, s."""
    low, high = (np.minimum(flow / rate_ul_s, LAG.rate_share) for flow in (before, after))
    rises = lag_s * np.log((1 - low) / (1 - high))
    falls = lag_s * np.log((1 + high) / (1 + low))
    return np.where(after >= before, rises, falls)


def _divided(toolpath: Toolpath, lag_s: float) -> Toolpath:
    """Writing moves cut in parts of a fraction of the lag where the flow changes."""
    flow, length = _flow(toolpath), toolpath.lengths
    writes = toolpath.kind == MoveKind.WRITE
    changes = np.abs(np.diff(flow)) > LAG.same * np.maximum(flow[1:], flow[:-1])
    changes &= writes[1:] & writes[:-1]
    near = writes & (np.concatenate([[False], changes]) | np.concatenate([changes, [False]]))
    lasts = np.divide(length, toolpath.speed_mm_s, out=np.zeros(len(length)), where=writes)
    wanted = np.floor(np.minimum(lasts * LAG.moves / lag_s, length / LAG.shortest_mm) + 1e-9)
    parts = np.where(near, np.maximum(wanted, 1), 1).astype(np.int64)
    of = np.repeat(np.arange(len(parts)), parts)
    number = np.arange(len(of)) - np.repeat(np.cumsum(parts) - parts, parts)
    rows = toolpath.where(of)
    way = rows.end - rows.start
    share = 1.0 / parts[of]
    begin = rows.start + (number * share)[:, None] * way
    end = np.where((number + 1 == parts[of])[:, None], rows.end, begin + share[:, None] * way)
    return replace(rows, start=begin, end=end, volume_ul=rows.volume_ul * share)


def _with_stands(toolpath: Toolpath, stands: _Stands, rate_ul_s: float) -> Toolpath:
    """Primes and retractions put in; a run's end before the next one's begin where they meet."""
    lasts = stands.lasts_s
    kept = np.flatnonzero(lasts != 0)
    at, row, lasts = stands.at[kept], stands.row[kept], lasts[kept]
    place = stands.place[kept]
    kind = np.where(lasts > 0, int(MoveKind.PRIME), int(MoveKind.RETRACT))
    return replace(
        toolpath,
        start=np.insert(toolpath.start, at, place, axis=0),
        end=np.insert(toolpath.end, at, place, axis=0),
        volume_ul=np.insert(toolpath.volume_ul, at, lasts * rate_ul_s),
        speed_mm_s=np.insert(toolpath.speed_mm_s, at, 0.0),
        duration_s=np.insert(toolpath.duration_s, at, np.abs(lasts)),
        tool=np.insert(toolpath.tool, at, toolpath.tool[row]),
        kind=np.insert(toolpath.kind, at, kind),
        source=np.insert(toolpath.source, at, toolpath.source[row]),
    )


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
    moves.plunge(-trip.relieve_ul, trip.plunger_ul_s, NO_SOURCE)
    up, across = from_mm.copy(), to_mm.copy()
    up[2] = across[2] = trip.over_mm
    moves.travel(up[None], trip.speed_mm_s, NO_SOURCE)
    moves.travel(np.stack([across, to_mm]), trip.speed_mm_s, NO_SOURCE)
    moves.plunge(trip.relieve_ul, trip.plunger_ul_s, NO_SOURCE)
    way = moves.build(must_write=False)
    return join_toolpaths([way, toolpath]), len(way)


def written_ul(toolpath: Toolpath) -> float:
    """Ink of its writing moves alone, µL."""
    return float(toolpath.volume_ul[toolpath.kind == MoveKind.WRITE].sum())
