"""Compute the ink that a held print should have laid so far, and what of it a look judges.

On a real machine nothing else is known, and the link proves that these lines were executed. Lines
put into the job (mends) are lines of the job like all others; they lie on the job's own paths.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.inspection import ExpectedLines, Gap, Stations
from printctl.machine.job.job import Job
from printctl.observe.mending import Gap as MendGap
from printctl.observe.mending import HeldPrint, Style, WrittenPath, written_paths

_LEVELS_BELOW: Final = 3
"""Levels below the judged one that may show through."""
_LEVEL_TOLERANCE_MM: Final = 1e-3
_MIN_OVERLAP_MM: Final = 0.05
"""Overlap above which two stretches belong to one gap."""


@dataclass(frozen=True)
class ExpectedInk:
    """Straight pieces of written ink, in the order of writing, printer's frame.

    Attributes
    ----------
    paths : tuple of WrittenPath
    start, end : (n, 3) float64, mm
        Of the tip.
    width_mm : (n,) float64, mm
        Of a line in a layer, or diameter of a filament, as the job requests it: without the
        correction of the flow.
    height_mm : (n,) float64, mm
        Thickness of the layer, or the diameter again.
    area_mm2 : (n,) float64, mm²
        Cross-section.
    command : (n,) int64
        Command of the job, from 0.
    stroke : (n,) int64
        Number of the path.
    time_s : (n,) float64, s
        Of its middle, by the job's own speeds, writing alone.
    factor : (n,) float64
        Ink that the grown job pushes there over what its file says.
    style : "layered" or "embedded"
    inserted : (n,) bool
        Of lines that were put into the job.
    """

    paths: tuple[WrittenPath, ...]
    start: FloatArray
    end: FloatArray
    width_mm: FloatArray
    height_mm: FloatArray
    area_mm2: FloatArray
    command: IntArray
    stroke: IntArray
    time_s: FloatArray
    factor: FloatArray
    style: Style
    inserted: BoolArray

    @property
    def layered(self) -> bool:
        """Whether lines are laid in layers."""
        return self.style == "layered"

    def between(self, first: int, last: int) -> BoolArray:
        """Return the mask of pieces written by the job's own commands ``first`` to ``last`` - 1."""
        return (self.command >= first) & (self.command < last) & ~self.inserted


def expected_ink(held_print: HeldPrint, job: Job) -> ExpectedInk:
    """Return all ink of a job up to the place where it is held.

    Parameters
    ----------
    held_print : HeldPrint
    job : Job
        The same job with its inserts, which correct the flow.
    """
    paths, none = written_paths(held_print), np.zeros(0)

    def joined(name: str) -> FloatArray:
        return np.concatenate([none, *(getattr(one, name) for one in paths)])

    command = joined("command").astype(np.int64)
    inserted, flow = np.zeros(len(job), dtype=np.bool_), np.ones(len(job))
    for one in job.inserts:
        flow[one.after + len(one.lines) :] = one.flow
    for after, count in job.positions:
        inserted[after : after + count], flow[after : after + count] = True, 1.0
    factor = flow[command]
    area, height = joined("e_per_mm") * held_print.ul_per_e / factor, joined("height_mm")
    if held_print.layered:
        width = held_print.ink.bead_section.width(area, height) if len(area) else area
    else:
        width = height = np.sqrt(4 / np.pi * area) * (held_print.ink.swell_factor or 1.0)
    start = np.vstack([np.zeros((0, 3)), *(one.points[:-1] for one in paths)])
    end = np.vstack([np.zeros((0, 3)), *(one.points[1:] for one in paths)])
    seconds = np.linalg.norm(end - start, axis=1) / np.maximum(joined("feed_mm_s"), 1e-9)
    stroke = np.repeat(np.arange(len(paths)), [len(one.command) for one in paths])
    time_s = np.cumsum(seconds) - seconds / 2
    return ExpectedInk(
        paths, start, end, width, height, area, command, stroke.astype(np.int64), time_s, factor,
        held_print.style, inserted[command],
    )  # fmt: skip


@dataclass(frozen=True)
class LayerInk:
    """Ink that a look inspects.

    Attributes
    ----------
    lines : ExpectedLines
        The judged ones and those below.
    row : (n,) int64
        Of the expected ink, of each.
    """

    lines: ExpectedLines
    row: IntArray

    @property
    def fresh_row(self) -> IntArray:
        """Row of the expected ink of each inspected line."""
        return self.row[self.lines.fresh]


def inspected_ink(ink: ExpectedInk, first: int, last: int) -> LayerInk:
    """Return the ink that a look after commands ``first`` to ``last`` is about.

    In layers: the topmost level written since, and what shows through from below. Embedded: all
    that was written since; older filaments lie around it.
    """
    written, fresh = ink.between(0, last), ink.between(first, last)
    if ink.layered and fresh.any():
        top = ink.end[fresh, 2].max()
        fresh &= ink.end[:, 2] > top - _LEVEL_TOLERANCE_MM
        depth = _LEVELS_BELOW * float(ink.height_mm[fresh].max())
        written &= ink.end[:, 2] > top - depth
    row = np.flatnonzero(written)
    start, end, width = ink.start[row], ink.end[row], ink.width_mm[row]
    return LayerInk(
        ExpectedLines(start, end, width, ink.command[row], ink.stroke[row], fresh[row]), row
    )


def layer_slab(ink: ExpectedInk, layer: LayerInk) -> tuple[float, float]:
    """Return middle and thickness of the inspected layer, mm; of all filaments in a bath."""
    rows = layer.fresh_row
    if not len(rows):
        return 0.0, 1.0
    top = float(ink.end[rows, 2].max())
    if ink.layered:
        thick = float(np.median(ink.height_mm[rows]))
        return top - thick / 2, thick
    z, half = np.stack([ink.start[rows, 2], ink.end[rows, 2]]), ink.height_mm[rows] / 2
    low, high = float((z - half).min()), float((z + half).max())
    return (low + high) / 2, high - low


@dataclass(frozen=True)
class MendedStretch:
    """Stretch of a path, mm along it, that was written again, and how often."""

    path: int
    from_mm: float
    to_mm: float
    tries: int = 1

    def overlap_mm(self, path: int, from_mm: float, to_mm: float) -> float:
        """Return the length shared with a stretch of a path, mm; 0 or less for none."""
        if path != self.path:
            return 0.0
        return min(self.to_mm, to_mm) - max(self.from_mm, from_mm)


def count_tries(gap: MendGap, mended: Sequence[MendedStretch]) -> int:
    """Return how often a gap, or a part of it, was mended before."""
    each = (
        one.tries
        for one in mended
        if one.overlap_mm(gap.path, gap.from_mm, gap.to_mm) > _MIN_OVERLAP_MM
    )
    return max(each, default=0)


def is_mended(gap: Gap, mended: Sequence[MendedStretch]) -> bool:
    """Return whether a gap and a mended stretch share half of the shorter one."""
    for one in mended:
        overlap = one.overlap_mm(gap.stroke, gap.from_mm, gap.to_mm)
        least = min(gap.length_mm, one.to_mm - one.from_mm)
        if overlap > _MIN_OVERLAP_MM and 2 * overlap >= least:
            return True
    return False


def unseen_words(stations: Stations, mended: Sequence[MendedStretch]) -> str:
    """Return in words how much of the mends is unseen, if half or more; else empty."""
    unseen_mm, whole_mm = 0.0, sum(one.to_mm - one.from_mm for one in mended)
    for one in mended:
        along = stations.along_mm
        own = (stations.stroke == one.path) & (along > one.from_mm) & (along < one.to_mm)
        unseen_mm += float(stations.length_mm[own & ~stations.seen].sum())
    if not mended or 2 * unseen_mm < whole_mm:
        return ""
    unseen_mm = min(unseen_mm, whole_mm)  # stations at an end reach a little over it
    return f"{unseen_mm:.2f} of {whole_mm:.2f} mm that were mended can't be seen: look yourself"


def last_mends(found: dict[str, Any] | None) -> tuple[tuple[MendedStretch, ...], int]:
    """Return the mends of the last judged look and the command from which it judged.

    Read from its record's figures; empty and 0 without such a look.
    """
    found = found or {}
    names = [one.name for one in fields(MendedStretch)]
    each = (MendedStretch(**{name: one[name] for name in names}) for one in found.get("mended", ()))
    return tuple(each), int(found.get("about_from", 0))
