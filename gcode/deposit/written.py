"""Select executed blocks that write ink; compute their volume and smoothed cross-section."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from gcode.deposit.kernels import writing_runs
from gcode.errors import DepositError
from gcode.motion.executed import ExecutedMotion, window_sums
from kernels.arrays import BoolArray, FloatArray, IntArray, split_rows


@dataclass(frozen=True)
class Strands:
    """Straight pieces that are written, in the order of writing.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
        Of the tip.
    dose_ul : (n,) float64, µL
    area_mm2 : (n,) float64, mm²
        Cross-section: the dose over the way, or over a window of it.
    stroke : (n,) int64
        Ascending: which unbroken line each is of.
    line : (n,) int64
        Of the file, from 1; of executed motion as `ExecutedMotion.line`.
    """

    start: FloatArray
    end: FloatArray
    dose_ul: FloatArray
    area_mm2: FloatArray
    stroke: IntArray
    line: IntArray

    @staticmethod
    def dosed(
        start: FloatArray, end: FloatArray, dose_ul: FloatArray, stroke: IntArray, line: IntArray
    ) -> Strands:
        """Return strands whose cross-section is each one's own dose over its way, above 0 mm."""
        length = np.linalg.norm(end - start, axis=1)
        return Strands(start, end, dose_ul, dose_ul / length, stroke, line)

    @staticmethod
    def joined(each: Sequence[Strands]) -> Strands:
        """Return those of several heads, one after the other; no two heads share a stroke."""
        past = np.cumsum([0, *(int(one.stroke.max(initial=-1)) + 1 for one in each)])
        own = [replace(one, stroke=one.stroke + k) for one, k in zip(each, past[:-1], strict=True)]
        return Strands(
            *(np.concatenate([getattr(one, item.name) for one in own]) for item in fields(Strands))
        )

    def __len__(self) -> int:
        return len(self.line)

    def chosen(self, rows: IntArray | BoolArray) -> Strands:
        """Return some of them, by number or mask."""
        return Strands(*(getattr(self, item.name)[rows] for item in fields(Strands)))

    def cut(self, rows: IntArray, begin: FloatArray, end: FloatArray) -> Strands:
        """Return parts of some of them, between shares (n,) of their way.

        What is whole keeps its ends to the last bit.
        """
        chosen, way = self.chosen(rows), (self.end - self.start)[rows]
        whole = (end - begin == 1.0)[:, None]
        return replace(
            chosen,
            start=chosen.start + begin[:, None] * way,
            end=np.where(whole, chosen.end, chosen.start + end[:, None] * way),
            dose_ul=chosen.dose_ul * (end - begin),
        )

    @property
    def length(self) -> FloatArray:
        """Way of each, (n,), mm."""
        return np.asarray(np.linalg.norm(self.end - self.start, axis=1))

    @property
    def radius(self) -> FloatArray:
        """Of each as a round filament, (n,), mm."""
        return np.sqrt(4 / np.pi * self.area_mm2) / 2

    @property
    def passes(self) -> int:
        """Number of unbroken lines."""
        return len(np.unique(self.stroke))

    def moved(self, by_mm: FloatArray) -> Strands:
        """Return the same, moved by (3,) mm."""
        return replace(self, start=self.start + by_mm, end=self.end + by_mm)


@dataclass(frozen=True)
class Written:
    """Lines as dosed, and the blocks that wrote them.

    Attributes
    ----------
    block : (n,) int64
        Of the executed motion, ascending.
    standing_ul : float, µL
        Net of primes and retractions, which deposit nothing.
    """

    lines: Strands
    block: IntArray
    standing_ul: float


def written(
    executed: ExecutedMotion,
    plunger_area_mm2: float,
    smoothing_mm: float = 1.0,
    plunger_step_mm: float | None = None,
) -> Written:
    """Return the lines that an executed motion writes.

    Parameters
    ----------
    executed : ExecutedMotion
        Of one head.
    smoothing_mm : float, mm
        Length of path over which the plunger's steps are smoothed.
    plunger_step_mm : float or None, mm
        As of `gcode.deposit.lay.deposit`.

    Raises
    ------
    DepositError
        When nothing is written, or an area or length isn't above 0.
    """
    check_positive(plunger_area_mm2=plunger_area_mm2, smoothing_mm=smoothing_mm)
    plunger = executed.plunger_end - executed.plunger_start
    length = np.linalg.norm(executed.end - executed.start, axis=1)
    run = _runs(executed, length, plunger, smoothing_mm, plunger_step_mm)
    chosen = np.flatnonzero(run >= 0)
    # Pressure lives through a short travel, but not through a retraction.
    stretch = np.cumsum(plunger < 0, dtype=np.int64)[chosen]
    dose = plunger[chosen] * plunger_area_mm2
    area = smoothed_area(stretch, length[chosen], dose, smoothing_mm)
    kept = area > 0
    chosen = chosen[kept]
    lines = Strands(
        executed.start[chosen],
        executed.end[chosen],
        dose[kept],
        area[kept],
        run[chosen],
        executed.line[chosen],
    )
    laid = float(plunger[chosen].sum()) * plunger_area_mm2
    return Written(lines, chosen, float(plunger.sum()) * plunger_area_mm2 - laid)


def check_positive(**values: float) -> None:
    """Raise `DepositError` for a value that isn't a number above 0."""
    for name, value in values.items():
        if not (np.isfinite(value) and value > 0):
            raise DepositError(f"{name} is {value:g}; it must be a number above 0")


def _runs(
    executed: ExecutedMotion,
    length: FloatArray,
    plunger: FloatArray,
    smoothing: float,
    step: float | None,
) -> IntArray:
    """Number of each block's stretch of writing; -1 for blocks that don't write."""
    pushed = plunger[(plunger > 0) & (length > 1e-9)].sum()
    if pushed <= 0:
        raise DepositError(
            "no block moves the needle while the plunger advances, so nothing was deposited; "
            "check that the job extrudes and that the extruder was hot enough to be allowed to"
        )
    move = executed.end - executed.start
    # Bridging freely first, to learn how much path one step of the plunger makes.
    run = writing_runs(length, plunger, move, smoothing / 2)
    quantum = _plunger_quantum(plunger) if step is None else step
    path_of_step = quantum * length[run >= 0].sum() / plunger[run >= 0].sum()
    return writing_runs(length, plunger, move, min(1.5 * path_of_step, smoothing / 2))


def _plunger_quantum(plunger: FloatArray) -> float:
    """Smallest difference between plunger travels: one motor step, if the motion is varied."""
    sizes = np.unique(np.round(np.abs(plunger), 7))
    steps = np.diff(np.concatenate([[0.0], sizes]))
    return float(steps[steps > 1e-6].min())


def smoothed_area(
    stretch: IntArray, length: FloatArray, volume: FloatArray, smoothing: float
) -> FloatArray:
    """Cross-section (n,), mm²: volume per length over a window around each block's middle.

    The window is `smoothing` or the block itself, whichever is longer, and ends where the
    stretch between two retractions does.
    """
    (taken,), way = window_sums(stretch, length, smoothing, volume)
    return np.asarray(taken / way)


class SamePath(NamedTuple):
    """When ink is written along older ink.

    The tip stands at the layer's height, so a line that is written over another one can't grow
    upwards: its ink goes aside, and the line becomes as wide as one of both volumes
    (`BeadSection.width` of the sum of their cross-sections). So a thin line is filled up by a
    second pass, and where a mend overlaps sound ink it bulges.

    Not modelled: what a needle drags along, lines that cross or lie beside each other (their ink is
    united without a bulge), and how far fresh ink flows under the tip to both sides alike.
    """

    station_mm: float = 0.3
    distance_mm: float = 0.03  # Distance of two axes that are one line: some motor steps.
    min_cosine: float = 0.99
    min_overlap_mm: float = 0.02  # Shorter overlaps aren't cut out: lines meet end to end.


SAME_PATH: Final = SamePath()


def united(strands: Strands) -> Strands:
    """Return layered strands in which what lies along older ink of its level holds both.

    Parameters
    ----------
    strands : Strands
        In the order of writing, each level's at one height.
    """
    pairs = _written_twice(strands) if len(strands) else np.zeros((0, 2), np.int64)
    if not len(pairs):
        return strands
    spans = np.array([_overlap(strands, old, new) for old, new in pairs.tolist()])
    real = (spans[:, 1] - spans[:, 0]) * strands.length[pairs[:, 0]] > SAME_PATH.min_overlap_mm
    pairs, spans = pairs[real], spans[real]
    cuts: dict[int, list[float]] = {}
    for (old, new), (a, b, c, d) in zip(pairs.tolist(), spans.tolist(), strict=True):
        cuts.setdefault(old, []).extend((a, b))
        cuts.setdefault(new, []).extend((c, d))
    pieces, of = _cut(strands, cuts)
    return _joined(pieces, of, pairs)


def _written_twice(strands: Strands) -> IntArray:
    """Pairs (k, 2) of an older and a newer strand that lie along each other somewhere."""
    length = strands.length
    count = np.maximum(1, np.ceil(length / SAME_PATH.station_mm)).astype(np.int64)
    of, number = split_rows(count)
    share = (number + 0.5) / count[of]
    way = strands.end - strands.start
    place = strands.start[of] + share[:, None] * way[of]
    close = cKDTree(place).query_pairs(
        SAME_PATH.station_mm / 2 + SAME_PATH.distance_mm, output_type="ndarray"
    )
    close = close[strands.stroke[of[close[:, 0]]] != strands.stroke[of[close[:, 1]]]]
    old, new = of[close.min(axis=1)], of[close.max(axis=1)]
    along = way / np.maximum(length, 1e-12)[:, None]
    step = place[close.max(axis=1)] - place[close.min(axis=1)]
    aside = step - (step * along[old]).sum(axis=1)[:, None] * along[old]
    one_line = np.abs((along[old] * along[new]).sum(axis=1)) > SAME_PATH.min_cosine
    one_line &= np.linalg.norm(aside, axis=1) < SAME_PATH.distance_mm
    one_line &= np.abs(step[:, 2]) < LEVEL_TOLERANCE_MM
    return np.unique(np.column_stack([old, new])[one_line], axis=0)


def _overlap(strands: Strands, old: int, new: int) -> tuple[float, float, float, float]:
    """Shares of the older and of the newer strand between which they lie along each other."""
    begin, way = strands.start[old], strands.end[old] - strands.start[old]
    square = float(way @ way)
    ends = [float((end[new] - begin) @ way) / square for end in (strands.start, strands.end)]
    low, high = max(0.0, min(ends)), min(1.0, max(ends))
    if high <= low:
        return 0.0, 0.0, 0.0, 0.0
    shares = sorted((at - ends[0]) / (ends[1] - ends[0]) for at in (low, high))
    return low, high, shares[0], shares[1]


def _cut(strands: Strands, cuts: dict[int, list[float]]) -> tuple[Strands, IntArray]:
    """Strands cut at shares of their way, and which strand each piece is of."""
    of, shares = list[int](), list[tuple[float, float]]()
    length = strands.length
    for k in range(len(strands)):
        least = SAME_PATH.min_overlap_mm / 2 / max(float(length[k]), 1e-12)
        at = [0.0]
        for cut in sorted(cuts.get(k, ())):
            if at[-1] + least < cut < 1.0 - least:
                at.append(cut)
        at.append(1.0)
        of += [k] * (len(at) - 1)
        shares += pairwise(at)
    row, (begin, end) = np.array(of), np.array(shares).T
    return strands.cut(row, begin, end), row


def _joined(pieces: Strands, of: IntArray, pairs: IntArray) -> Strands:
    """Pieces whose ink lies along a newer one are left out; that one has it in addition."""
    area, dose = pieces.area_mm2.copy(), pieces.dose_ul.copy()
    middle, kept = (pieces.start + pieces.end) / 2, np.ones(len(of), dtype=np.bool_)
    first = np.searchsorted(of, np.arange(of.max() + 2))
    for old, new in pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].tolist():
        mine, its = slice(first[new], first[new + 1]), range(first[old], first[old + 1])
        for piece in its:
            away = np.linalg.norm(middle[mine] - middle[piece], axis=1)
            k = int(away.argmin())
            if kept[piece] and away[k] < 2 * SAME_PATH.distance_mm:
                kept[piece] = False
                area[first[new] + k] += area[piece]
                dose[first[new] + k] += dose[piece]
    return replace(pieces, area_mm2=area, dose_ul=dose).chosen(kept)


SMOOTHING_MM: Final = 1.0
"""Length of bead over which ink and syringe give way, so that single plunger steps even out."""
LEVEL_TOLERANCE_MM = 5e-3
"""Written heights closer than this are one level (two steps of a usual z axis)."""
_THICKER = 1.5
"""Lines that hold so many times the usual cross-section are higher, not wider."""


def written_levels(heights: FloatArray) -> FloatArray:
    """Distinct written heights, ascending, mm."""
    ordered = np.unique(np.round(heights, 4))
    new = np.concatenate([[True], np.diff(ordered) > LEVEL_TOLERANCE_MM])
    return ordered[new]


def _level_heights(levels: FloatArray, area_mm2: FloatArray, single_mm: float | None) -> FloatArray:
    """Height of the lines of each level (k,), which hold a median ``area_mm2`` (k,); mm."""
    gaps = np.diff(levels)
    if len(gaps) == 0 and single_mm is not None:
        return np.array([single_mm])
    if len(gaps) == 0:
        raise DepositError(
            "the print has a single layer, whose height is unknown; give it (--layer-um), or write "
            "at least two layers"
        )
    values, counts = np.unique(np.round(gaps, 3), return_counts=True)
    usual = float(values[counts.argmax()])
    more = area_mm2 / np.median(area_mm2[1:][np.abs(gaps - usual) < 1e-3])
    likely = np.where(more > _THICKER, more * usual, usual)[1:]
    gaps = np.where(gaps > 2 * likely, likely, gaps)
    fits = 1 / _THICKER < more[0] * usual / gaps[0] < _THICKER
    return np.concatenate([[gaps[0] if fits else usual], gaps])


@dataclass(frozen=True)
class Layering:
    """Levels of layered writing, and how high the lines of each are: down to the level below.

    A slicer that varies its layers keeps its lines' width, so a level whose lines hold more than
    the usual ones may be as much higher. One that hangs more than twice so high above the last
    takes that height, or where its lines are the usual ones the most frequent spacing. The lowest
    takes the next one's where its lines hold as much for it, else the most frequent spacing.

    Attributes
    ----------
    levels, height_mm : (k,) float64, mm
        Where the tip wrote, ascending; and how far the lines hang below it.
    """

    levels: FloatArray
    height_mm: FloatArray

    @staticmethod
    def of(lines: Strands, single_mm: float | None = None) -> Layering:
        """Find them in written lines; parameters as of `at`."""
        return Layering.at(lines.end[:, 2], lines.area_mm2, single_mm)

    @staticmethod
    def at(z_mm: FloatArray, area_mm2: FloatArray, single_mm: float | None = None) -> Layering:
        """Find them in the written heights (n,) of lines, mm, and their cross-sections (n,), mm².

        Parameters
        ----------
        single_mm : float or None, mm
            Height of the lines of a single level: of a print that has but begun.

        Raises
        ------
        DepositError
            When there is a single level, and its height isn't given.
        """
        levels = written_levels(z_mm)
        order = np.argsort(z_mm, kind="stable")
        first = np.searchsorted(z_mm[order], levels - 1e-6)
        areas = np.array([np.median(own) for own in np.split(area_mm2[order], first[1:])])
        return Layering(levels, _level_heights(levels, areas, single_mm))

    def number(self, z_mm: FloatArray) -> IntArray:
        """Level of each written height, (n,)."""
        return np.clip(np.searchsorted(self.levels, z_mm + 1e-6, side="right") - 1, 0, None)

    def heights(self, z_mm: FloatArray) -> FloatArray:
        """Height of the lines that are written there, (n,), mm."""
        return self.height_mm[self.number(z_mm)]
