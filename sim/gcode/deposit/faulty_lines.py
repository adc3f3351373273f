"""Apply ink faults to written lines: change the flow, drop, shift or sag lines, add clumps."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from sim.gcode.deposit.ink_faults import Debris, InkFaults, Lost, Sag, Skip
from sim.gcode.deposit.ink_flow import FlowChange, flow_change
from sim.gcode.deposit.ink_timeline import Timeline
from sim.gcode.deposit.levels import Layering
from sim.gcode.deposit.strands import Strands

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
        chosen = {item.name: getattr(self.strands, item.name)[rows] for item in fields(Strands)}
        return Placed(Strands(**chosen), self.first[rows], self.last[rows])


def faulty_lines(
    lines: Placed, timeline: Timeline, faults: InkFaults, layering: Layering | None
) -> Strands:
    """Return what the faults leave of lines, and what they add."""
    changes = [flow_change(fault, timeline) for fault in faults.each]
    flows = [change for change in changes if change is not None]
    begins = np.array([timeline.begins(fault) for fault in faults.each])
    cuts = np.concatenate([begins, *(change.cuts for change in flows)])
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
    of = np.repeat(np.arange(len(parts)), parts)
    number = np.arange(len(of)) - np.repeat(np.cumsum(parts) - parts, parts)
    padded = np.append(cuts, np.inf)
    first = np.where(number == 0, lines.first[of], padded[low[of] + number - 1])
    last = np.where(number == parts[of] - 1, lines.last[of], padded[low[of] + number])
    lasts = (lines.last - lines.first)[of]
    begin, end = (first - lines.first[of]) / lasts, (last - lines.first[of]) / lasts
    old = lines.strands
    start, way = old.start[of], (old.end - old.start)[of]
    # What isn't cut keeps its ends to the last bit.
    whole = (parts[of] == 1)[:, None]
    return Placed(
        Strands(
            start + begin[:, None] * way,
            np.where(whole, old.end[of], start + end[:, None] * way),
            old.dose_ul[of] * (end - begin),
            old.area_mm2[of],
            old.stroke[of],
            old.line[of],
        ),
        first,
        last,
    )


def _thinned(lines: Placed, flows: list[FlowChange]) -> Placed:
    factor = np.ones(len(lines.first))
    for change in flows:
        factor = factor * change.factor(lines.middle)
    old = lines.strands
    ink = replace(old, dose_ul=old.dose_ul * factor, area_mm2=old.area_mm2 * factor)
    return replace(lines, strands=ink).kept(factor > _NOTHING)


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
    old = lines.strands
    return replace(lines, strands=replace(old, start=old.start + shift, end=old.end + shift))


def _sagged(lines: Placed, fault: Sag, begin: float, layering: Layering | None) -> Placed:
    if layering is None:
        return _shifted(lines, np.array([0.0, 0.0, -fault.drop_mm]), begin)
    wider = np.where(lines.middle >= begin, 1 + fault.percent / 100, 1.0)
    old = lines.strands
    return replace(lines, strands=replace(old, area_mm2=old.area_mm2 * wider))


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
    return Placed(
        Strands(
            np.insert(old.start, row, at, axis=0),
            np.insert(old.end, row, at + [_CLUMP_MM, 0.0, 0.0], axis=0),
            np.insert(old.dose_ul, row, volume),
            np.insert(old.area_mm2, row, area),
            np.insert(old.stroke, row, old.stroke[row]),
            np.insert(old.line, row, old.line[row]),
        ),
        np.insert(lines.first, row, begin),
        np.insert(lines.last, row, begin),
    )


def _strokes(lines: Placed) -> IntArray:
    """Number of each line's unbroken path, which ends where ink is missing."""
    stroke, place = lines.strands.stroke, lines.strands
    if not len(stroke):
        return stroke
    apart = np.linalg.norm(place.start[1:] - place.end[:-1], axis=1) > _CLUMP_MM / 2
    return np.concatenate([[0], np.cumsum(apart | (np.diff(stroke) != 0))]).astype(np.int64)
