"""Data class of laid ink as straight pieces; collect it from written paths without their gaps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.observe.mending.gap import Gap
from printctl.observe.mending.held_print import HeldPrint, WrittenPath


@dataclass(frozen=True, eq=False)
class LaidInk:
    """Straight pieces of ink in the order of writing, printer's frame.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
        Of the tip.
    width_mm, height_mm : (n,) float64, mm
        A line hangs below the tip by its height; of a filament both are the diameter.
    path : (n,) int64
        `WrittenPath` of each.
    """

    start: FloatArray
    end: FloatArray
    width_mm: FloatArray
    height_mm: FloatArray
    path: IntArray

    def __len__(self) -> int:
        return len(self.path)

    @property
    def length_mm(self) -> FloatArray:
        """Of each, (n,), mm."""
        return np.asarray(np.linalg.norm(self.end - self.start, axis=1))

    def top_mm(self, *, layered: bool) -> float:
        """Highest ink, mm; -inf without any."""
        if not len(self):
            return -np.inf
        above = 0.0 if layered else self.width_mm / 2
        return float((np.maximum(self.start[:, 2], self.end[:, 2]) + above).max())

    def where(self, rows: BoolArray) -> LaidInk:
        """The pieces of a mask."""
        return LaidInk(
            self.start[rows],
            self.end[rows],
            self.width_mm[rows],
            self.height_mm[rows],
            self.path[rows],
        )


def nearest_pieces(places: FloatArray, ink: LaidInk) -> tuple[IntArray, FloatArray]:
    """Return the piece of ink whose axis is nearest to each place, (m,), and its distance, mm."""
    piece, away = np.zeros(len(places), np.int64), np.full(len(places), np.inf)
    if not len(ink):
        return piece, away
    step = ink.end - ink.start
    square = np.maximum((step**2).sum(axis=1), 1e-18)
    for k, place in enumerate(places):
        share = np.clip(((place - ink.start) * step).sum(axis=1) / square, 0.0, 1.0)
        gap = np.linalg.norm(ink.start + share[:, None] * step - place, axis=1)
        piece[k] = gap.argmin()
        away[k] = gap[piece[k]]
    return piece, away


def stretch_of(path: WrittenPath, from_mm: float, to_mm: float) -> LaidInk:
    """Ink of a stretch of one path, if it is sound."""
    cuts = path.cuts(from_mm, to_mm)
    middle = (cuts[:-1] + cuts[1:]) / 2
    piece, points = path.piece(middle), path.at(cuts)
    number = np.full(len(piece), path.number, dtype=np.int64)
    return LaidInk(points[:-1], points[1:], path.width_mm[piece], path.height_mm[piece], number)


def width_with_more(
    width_mm: FloatArray, height_mm: FloatArray, times: FloatArray, held: HeldPrint
) -> FloatArray:
    """Return the width of lines with so many times their ink, (m,), mm.

    A line of a layer stands no higher under the needle, so more ink goes to its sides, as the bead
    model says of it.

    Parameters
    ----------
    width_mm, height_mm : (m,) float64, mm
    times : (m,) float64
        2 where a line is written onto a sound one.
    held : HeldPrint
    """
    if held.style == "embedded":
        return width_mm * np.sqrt(times)
    return held.ink.bead_section.width(times * section_mm2(width_mm, height_mm, held), height_mm)


def section_mm2(width_mm: FloatArray, height_mm: FloatArray, held: HeldPrint) -> FloatArray:
    """Return the cross-section of lines as they are dosed, (m,), mm²."""
    if held.style == "embedded":
        return np.pi / 4 * (width_mm / (held.ink.swell_factor or 1.0)) ** 2
    return held.ink.bead_section.area(width_mm, height_mm)


def laid_ink(paths: Sequence[WrittenPath], gaps: Sequence[Gap] = ()) -> LaidInk:
    """Return all ink of paths, but for what is missing in gaps (thin stretches count as ink)."""
    broken = {gap.path for gap in gaps if gap.whole}
    parts = []
    for path in paths:
        spans = sound_spans(path, gaps) if path.number in broken else []
        parts += [stretch_of(path, *span) for span in spans]
        if path.number not in broken:
            parts.append(_whole(path))
    if not parts:
        nothing = np.zeros((0, 3))
        return LaidInk(nothing, nothing, np.zeros(0), np.zeros(0), np.zeros(0, np.int64))
    return joined_ink(parts)


def _whole(path: WrittenPath) -> LaidInk:
    number = np.full(len(path.command), path.number, dtype=np.int64)
    return LaidInk(path.points[:-1], path.points[1:], path.width_mm, path.height_mm, number)


def joined_ink(parts: Sequence[LaidInk]) -> LaidInk:
    """Return ink one after the other."""
    names = ("start", "end", "width_mm", "height_mm", "path")
    return LaidInk(*(np.concatenate([getattr(one, name) for one in parts]) for name in names))


def sound_spans(path: WrittenPath, gaps: Sequence[Gap]) -> list[tuple[float, float]]:
    """Stretches of a path outside its whole gaps, mm along it."""
    spans, begin = [], 0.0
    own = sorted((g.from_mm, g.to_mm) for g in gaps if g.path == path.number and g.whole)
    for low, high in own:
        if low > begin:
            spans.append((begin, low))
        begin = max(begin, high)
    if begin < path.length_mm:
        spans.append((begin, path.length_mm))
    return spans
