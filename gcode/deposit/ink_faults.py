"""Ink faults during a simulated print, from the fault file's list `ink`.

::

    ink:
      - {fault: clog, written_mm: 120, clears_ul: 0.5}      # nothing comes until 0.5 µL are purged
      - {fault: clog, line: 900, passes: 0.4, lasts_mm: 30} # a partial clog, for 30 mm of line
      - {fault: drift, written_mm: 200, factor: 1.3}        # a step; over_mm: 80 makes it a ramp
      - {fault: temperature, time_s: 0, amplitude: 0.1, period_s: 240}
      - {fault: bubble, pushed_ul: 1.5, ul: 0.05, catches_up: 0.6}
      - {fault: empty, pushed_ul: 40, fades_ul: 1}
      - {fault: lost, line: 400}                            # the stroke written there isn't laid
      - {fault: lost, written_mm: 0, strokes: 100000, share: 0.01}
      - {fault: skip, time_s: 60, shift_mm: [0.3, 0]}
      - {fault: sag, written_mm: 300, percent: 25, drop_mm: 0.1}
      - {fault: debris, written_mm: 50, diameter_mm: 0.4, offset_mm: [0.2, 0.1]}

Each begins at one moment: ``line`` (of the job's commands, from 1; the first that is executed from
there on), ``time_s`` (printer's clock), ``written_mm`` (way of written lines, mends included) or
``pushed_ul`` (pushed by the plunger beyond its foremost place, all syringes together). The motors
know nothing of them: the simulated scanner and camera do (`gcode.deposit.lay`).

A purge is what the plunger pushes beyond its foremost place while the tip stands, or along a way
with at least `PURGE.ratio` times the job's median dose per mm.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, Final, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from gcode.deposit.written import Layering, Strands
from gcode.user_files import FileSection
from kernels.arrays import BoolArray, FloatArray, IntArray, split_rows


class PurgeRules(NamedTuple):
    """What counts as a purge."""

    ratio: float = 2.0
    least_ul: float = 0.02  # Less in a move that stands is the rounding of a prime to motor steps.
    # No retraction is so long: a plunger that goes back farther is put to a full syringe.
    reload_ul: float = 30.0


PURGE: Final = PurgeRules()

Amount = Annotated[float, Field(ge=0, le=1e6)]
More = Annotated[float, Field(gt=0, le=1e6)]
Share = Annotated[float, Field(ge=0, le=1)]
_Way = Annotated[float, Field(ge=-100, le=100)]
Shift = tuple[_Way, _Way]


class Moment(FileSection):
    """Where a fault begins: exactly one of four measures, see the module; `head` alone or all."""

    line: Annotated[int, Field(ge=1)] | None = None
    time_s: Amount | None = None
    written_mm: Amount | None = None
    pushed_ul: Amount | None = None
    head: Annotated[int, Field(ge=0)] | None = None

    @model_validator(mode="after")
    def _is_one(self) -> Moment:
        given = (self.line, self.time_s, self.written_mm, self.pushed_ul)
        if sum(value is not None for value in given) != 1:
            raise ValueError("give one of line, time_s, written_mm and pushed_ul as the moment")
        return self


class Clog(Moment):
    """The needle lets through the share `passes`: for `lasts_mm`, until purged, or for good."""

    fault: Literal["clog"]
    passes: Annotated[float, Field(ge=0, lt=1)] = 0.0
    lasts_mm: More | None = None
    clears_ul: More | None = Field(default=None, description="A purge of this mends it.")


class Drift(Moment):
    """The flow becomes `factor` times what is pushed: at once, or evenly over `over_mm`."""

    fault: Literal["drift"]
    factor: Annotated[float, Field(gt=0, le=5)]
    over_mm: Amount = 0.0


class Temperature(Moment):
    """The flow swings by `amplitude` about what is pushed, as a heater's swing makes it."""

    fault: Literal["temperature"]
    amplitude: Annotated[float, Field(gt=0, lt=1)]
    period_s: Annotated[float, Field(ge=0.1, le=1e6)]


class Bubble(Moment):
    """Air of `ul` passes in place of ink; of that, `catches_up` comes on top of the next `ul`."""

    fault: Literal["bubble"]
    ul: More
    catches_up: Share = 0.0


class Empty(Moment):
    """The syringe is empty: the flow fades over `fades_ul`, and nothing comes any more."""

    fault: Literal["empty"]
    fades_ul: Amount = 0.0


class Lost(Moment):
    """Strokes don't stick to what is below: of `strokes` from the moment on each by a chance."""

    fault: Literal["lost"]
    strokes: Annotated[int, Field(ge=1)] = 1
    share: Share = 1.0


class Skip(Moment):
    """A motor loses steps: all that is laid from then on is shifted."""

    fault: Literal["skip"]
    shift_mm: Shift


class Sag(Moment):
    """Ink spreads: a layered line becomes wider, a filament in a bath sinks."""

    fault: Literal["sag"]
    percent: Annotated[float, Field(ge=0, le=200)] = 0.0
    drop_mm: Annotated[float, Field(ge=0, le=10)] = 0.0


class Debris(Moment):
    """A clump of ink falls beside the line that is being written."""

    fault: Literal["debris"]
    diameter_mm: Annotated[float, Field(gt=0, le=10)]
    offset_mm: Shift = (0.0, 0.0)


InkFault = Annotated[
    Clog | Drift | Temperature | Bubble | Empty | Lost | Skip | Sag | Debris,
    Field(discriminator="fault"),
]


@dataclass(frozen=True)
class InkFaults:
    """Faults of the ink in a print, and the seed of their chances."""

    each: tuple[InkFault, ...] = ()
    seed: int = 0

    def of_head(self, number: int) -> InkFaults:
        """Those that befall one head."""
        return InkFaults(tuple(one for one in self.each if one.head in (None, number)), self.seed)


NO_FAULTS: Final = InkFaults()


_NOTHING = 1e-6
"""Share of the flow that isn't ink any more."""
_CLUMP_MM = 1e-4
"""Length of a clump's strand, whose diameter is its size."""


@dataclass(frozen=True)
class Placed:
    """Lines, and the places in the print (`ink_timeline`) between which each is laid."""

    strands: Strands
    first: FloatArray
    last: FloatArray

    @property
    def middle(self) -> FloatArray:
        """Place in the middle of each line, (n,)."""
        return (self.first + self.last) / 2

    def kept(self, rows: BoolArray) -> Placed:
        """Some of the lines."""
        return Placed(self.strands.chosen(rows), self.first[rows], self.last[rows])

    def changed(self, **columns: Any) -> Placed:
        """The same with other columns of strands."""
        return replace(self, strands=replace(self.strands, **columns))


def faulty_lines(
    lines: Placed, timeline: Timeline, faults: InkFaults, layering: Layering | None
) -> Strands:
    """Return what the faults leave of lines, and what they add."""
    changes = [flow_change(fault, timeline) for fault in faults.each]
    flows = [change for change in changes if change is not None]
    begins = np.array([timeline.begins(fault) for fault in faults.each])
    cuts = np.concatenate([begins, *(places for places, _ in flows)])
    lines = _thinned(_cut(lines, np.unique(cuts[np.isfinite(cuts)])), flows)
    clumps = []
    for number, (fault, begin) in enumerate(zip(faults.each, begins.tolist(), strict=True)):
        if math.isinf(begin):
            continue
        match fault:
            case Lost():
                lines = _without(lines, fault, begin, (faults.seed, number))
            case Skip():
                lines = _shifted(lines, np.array([*fault.shift_mm, 0.0]), begin)
            case Sag():
                lines = _sagged(lines, fault, begin, layering)
            case Debris():
                clumps.append((fault, begin))
    for clump, begin in clumps:
        lines = _with_clump(lines, clump, begin, layering)
    return replace(lines.strands, stroke=_strokes(lines))


def _cut(lines: Placed, cuts: FloatArray) -> Placed:
    """Lines cut at places, so that none goes across one."""
    low = np.searchsorted(cuts, lines.first, side="right")
    high = np.maximum(np.searchsorted(cuts, lines.last, side="left"), low)
    parts = high - low + 1
    of, number = split_rows(parts)
    padded = np.append(cuts, np.inf)
    first = np.where(number == 0, lines.first[of], padded[low[of] + number - 1])
    last = np.where(number == parts[of] - 1, lines.last[of], padded[low[of] + number])
    lasts = (lines.last - lines.first)[of]
    begin, end = (first - lines.first[of]) / lasts, (last - lines.first[of]) / lasts
    return Placed(lines.strands.cut(of, begin, end), first, last)


def _thinned(lines: Placed, flows: list[FlowChange]) -> Placed:
    factor = np.ones(len(lines.first))
    for _, change in flows:
        factor = factor * change(lines.middle)
    old = lines.strands
    thinned = lines.changed(dose_ul=old.dose_ul * factor, area_mm2=old.area_mm2 * factor)
    return thinned.kept(factor > _NOTHING)


def _without(lines: Placed, fault: Lost, begin: float, seed: tuple[int, int]) -> Placed:
    """Lines without the strokes that didn't stick."""
    behind = lines.last > begin
    if not behind.any():
        return lines
    stroke = lines.strands.stroke
    first = int(stroke[behind.argmax()])
    number = stroke - first
    # A stroke's chance is its own, however long the print has become.
    draws = np.random.default_rng(seed).random(max(1, min(int(number.max()) + 1, fault.strokes)))
    within = (number >= 0) & (number < fault.strokes)
    lost = within & (draws[np.clip(number, 0, len(draws) - 1)] < fault.share)
    return lines.kept(~lost)


def _shifted(lines: Placed, by_mm: FloatArray, begin: float) -> Placed:
    shift = (lines.middle >= begin)[:, None] * by_mm
    return lines.changed(start=lines.strands.start + shift, end=lines.strands.end + shift)


def _sagged(lines: Placed, fault: Sag, begin: float, layering: Layering | None) -> Placed:
    if layering is None:
        return _shifted(lines, np.array([0.0, 0.0, -fault.drop_mm]), begin)
    wider = np.where(lines.middle >= begin, 1 + fault.percent / 100, 1.0)
    return lines.changed(area_mm2=lines.strands.area_mm2 * wider)


def _with_clump(lines: Placed, fault: Debris, begin: float, layering: Layering | None) -> Placed:
    """Lines with a clump beside the one that is written then, or next."""
    behind = np.flatnonzero(lines.last > begin)
    if not len(behind):
        return lines
    row, old = int(behind[0]), lines.strands
    share = max(0.0, begin - lines.first[row]) / (lines.last[row] - lines.first[row])
    at = old.start[row] + share * (old.end[row] - old.start[row]) + [*fault.offset_mm, 0.0]
    if layering is None:
        area = math.pi / 4 * fault.diameter_mm**2
        volume = math.pi / 6 * fault.diameter_mm**3
    else:
        height = float(layering.heights(at[None, 2])[0])
        area, volume = fault.diameter_mm * height, math.pi / 4 * fault.diameter_mm**2 * height
    end = at + [_CLUMP_MM, 0.0, 0.0]
    clump = (at, end, volume, area, old.stroke[row], old.line[row])
    columns = (getattr(old, column.name) for column in fields(Strands))
    strands = (np.insert(own, row, new, axis=0) for own, new in zip(columns, clump, strict=True))
    ends = (np.insert(place, row, begin) for place in (lines.first, lines.last))
    return Placed(Strands(*strands), *ends)


def _strokes(lines: Placed) -> IntArray:
    """Number of each line's unbroken path, which ends where ink is missing."""
    stroke, place = lines.strands.stroke, lines.strands
    if not len(stroke):
        return stroke
    apart = np.linalg.norm(place.start[1:] - place.end[:-1], axis=1) > _CLUMP_MM / 2
    return np.concatenate([[0], np.cumsum(apart | (np.diff(stroke) != 0))]).astype(np.int64)


_STEPS: Final = 40
"""Of a ramp, and of a period."""
_MOST_CUTS: Final = 100_000


FlowChange = tuple[FloatArray, Callable[[FloatArray], FloatArray]]
"""What a fault does to the flow: the places (k,) at which lines must be cut, and the flow over what
is pushed (n,) at places (n,), which holds within each piece."""


def flow_change(fault: InkFault, line: Timeline) -> FlowChange | None:
    """Return what a fault does to the flow; None for nothing, or not yet."""
    begin = line.begins(fault)
    if math.isinf(begin):
        return None
    match fault:
        case Clog():
            return _clog(fault, line, begin)
        case Drift():
            return _ramp(line.written_mm, begin, fault.over_mm, fault.factor)
        case Temperature():
            return _swing(fault, line, begin)
        case Bubble():
            return _bubble(fault, line, begin)
        case Empty():
            return _ramp(line.pushed_ul, begin, fault.fades_ul, 0.0)
    return None


def _clog(fault: Clog, line: Timeline, begin: float) -> FlowChange:
    end = math.inf
    if fault.lasts_mm is not None:
        end = when(line.written_mm, float(at(line.written_mm, begin)) + fault.lasts_mm)
    if fault.clears_ul is not None:
        end = min(end, when(line.purged_ul, float(at(line.purged_ul, begin)) + fault.clears_ul))
    cuts = np.array([place for place in (begin, end) if math.isfinite(place)])
    return cuts, lambda place: np.where((place >= begin) & (place < end), fault.passes, 1.0)


def _ramp(total: FloatArray, begin: float, over: float, to: float) -> FlowChange:
    """From 1 to `to` while a running sum grows by `over`; at once for 0."""
    first = float(at(total, begin))
    if over <= 0:
        return np.array([begin]), lambda place: np.where(place >= begin, to, 1.0)

    def factor(place: FloatArray) -> FloatArray:
        done = np.clip((at(total, place) - first) / over, 0.0, 1.0)
        return np.where(place >= begin, 1.0 + (to - 1.0) * done, 1.0)

    return _reached(total, first + over * np.linspace(0, 1, _STEPS + 1)), factor


def _swing(fault: Temperature, line: Timeline, begin: float) -> FlowChange:
    zero = float(line.seconds(np.array([begin]))[0])
    last = float(line.time_s[-1, 1])
    step = max(fault.period_s / _STEPS, (last - zero) / _MOST_CUTS)
    cuts = line.at_times(np.arange(zero, last, step))

    def factor(place: FloatArray) -> FloatArray:
        phase = 2 * np.pi * (line.seconds(place) - zero) / fault.period_s
        return np.where(place >= begin, 1.0 + fault.amplitude * np.sin(phase), 1.0)

    return np.append(begin, cuts), factor


def _bubble(fault: Bubble, line: Timeline, begin: float) -> FlowChange:
    first = float(at(line.pushed_ul, begin))

    def factor(place: FloatArray) -> FloatArray:
        passed = (at(line.pushed_ul, place) - first) / fault.ul
        after = np.where(passed < 2.0, 1.0 + fault.catches_up, 1.0)
        return np.where(place < begin, 1.0, np.where(passed < 1.0, 0.0, after))

    cuts = _reached(line.pushed_ul, first + fault.ul * np.array([1.0, 2.0]))
    return np.append(begin, cuts), factor


def _reached(total: FloatArray, values: FloatArray) -> FloatArray:
    places = np.array([when(total, float(value)) for value in values])
    return places[np.isfinite(places)]


@dataclass(frozen=True)
class Timeline:
    """Running sums at the blocks' ends.

    A place in a print is a number: whole part the block, rest the share of that block which is
    done. It ascends whatever the printer's clock does (a reset sets that to 0).

    Attributes
    ----------
    time_s : (n, 2) float64, s
        Begin and end of each block.
    line : (n,) int64
        Command of the job, from 0; -1 for none of it.
    written_mm, pushed_ul, purged_ul : (n + 1,) float64
        Before each block, and after the last.
    """

    time_s: FloatArray
    line: IntArray
    written_mm: FloatArray
    pushed_ul: FloatArray
    purged_ul: FloatArray

    @staticmethod
    def of(
        time_s: FloatArray,
        line: IntArray,
        way_mm: FloatArray,
        push_ul: FloatArray,
        writes: BoolArray,
    ) -> Timeline:
        """Sum up blocks: their way, what the plunger pushes (below 0: goes back), which write."""
        new = _pushed_anew(push_ul)
        dense = np.divide(new, way_mm, out=np.full(len(new), np.inf), where=way_mm > 0)
        usual = np.median(dense[writes & (new > 0)]) if (writes & (new > 0)).any() else np.inf
        purge = np.where((new >= PURGE.least_ul) & (dense >= PURGE.ratio * usual), new, 0.0)
        return Timeline(
            time_s,
            line,
            np.concatenate([[0.0], np.cumsum(np.where(writes, way_mm, 0.0))]),
            np.concatenate([[0.0], np.cumsum(new)]),
            np.concatenate([[0.0], np.cumsum(purge)]),
        )

    def begins(self, moment: Moment) -> float:
        """Place at which a fault begins; inf when the print hasn't come so far."""
        if moment.line is not None:
            reached = self.line >= moment.line - 1
            return float(reached.argmax()) if reached.any() else math.inf
        if moment.written_mm is not None:
            return when(self.written_mm, moment.written_mm)
        if moment.pushed_ul is not None:
            return when(self.pushed_ul, moment.pushed_ul)
        return float(self.at_times(np.array([moment.time_s or 0.0]))[0])

    def seconds(self, place: FloatArray) -> FloatArray:
        """Printer's clock at places, s."""
        block = np.clip(np.asarray(place).astype(np.int64), 0, max(len(self.line) - 1, 0))
        begin, end = self.time_s[block].T
        return np.asarray(begin + (place - block) * (end - begin))

    def at_times(self, seconds: FloatArray) -> FloatArray:
        """Places at times of the printer's clock, (n,); inf where the print hasn't come so far."""
        ends = np.maximum.accumulate(self.time_s[:, 1])
        index = np.searchsorted(ends, seconds, side="left")
        block = np.minimum(index, len(ends) - 1)
        begin, end = self.time_s[block].T
        lasts = np.where(end > begin, end - begin, 1.0)
        share = np.clip((seconds - begin) / lasts, 0.0, 1.0)
        return np.where(index < len(ends), block + share, np.inf)


def _pushed_anew(push_ul: FloatArray) -> FloatArray:
    """What each block pushes beyond the plunger's foremost place, (n,), µL.

    A plunger that goes back by more than `PURGE.reload_ul` comes to a full syringe.
    """
    total = np.concatenate([[0.0], np.cumsum(push_ul)])
    new, begin = np.zeros(len(push_ul)), 0
    while begin < len(push_ul):
        foremost = np.maximum.accumulate(total[begin:])
        back = np.flatnonzero(foremost - total[begin:] > PURGE.reload_ul)
        if not len(back):
            new[begin:] = np.diff(foremost)
            break
        turn = begin + int(back[0])
        new[begin:turn] = np.diff(foremost[: turn - begin + 1])
        forward = np.flatnonzero(push_ul[turn:] > 0)
        begin = turn + int(forward[0]) if len(forward) else len(push_ul)
    return new


def at(total: FloatArray, place: FloatArray | float) -> FloatArray:
    """A running sum at places."""
    return np.asarray(np.interp(place, np.arange(len(total)), total))


def when(total: FloatArray, value: float) -> float:
    """First place at which a running sum reaches a value; inf when it doesn't."""
    block = int(np.searchsorted(total[1:], value, side="left"))
    if block == len(total) - 1:
        return math.inf
    low, high = float(total[block]), float(total[block + 1])
    return block + (max(0.0, (value - low) / (high - low)) if high > low else 0.0)
