"""Gaps in written paths, and the ink that lies on the paths outside their gaps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.observe.mending.held_print import HeldPrint, MendError, WrittenPath


@dataclass(frozen=True)
class Gap:
    """Stretch of a path without ink, or with too little.

    Attributes
    ----------
    path : int
        Number of the `WrittenPath`.
    from_mm, to_mm : float, mm
        Way along it.
    missing : float
        Share of the ink that isn't there: 1 for none at all.
    flow : float
        Plunger over way against the path's own lines: what the flow has been corrected by since
        they were written.
    """

    path: int
    from_mm: float
    to_mm: float
    missing: float = 1.0
    flow: float = 1.0

    @property
    def length_mm(self) -> float:
        """Along the path."""
        return self.to_mm - self.from_mm

    @property
    def whole(self) -> bool:
        """Whether nothing at all lies there."""
        return self.missing >= 1.0

    def left(self, reason: str) -> NotMended:
        """Return the gap as a stretch that stays unmended."""
        return NotMended(self.path, self.from_mm, self.to_mm, reason)


@dataclass(frozen=True)
class NotMended:
    """Stretch of a path that stays as it is, mm along it, and why, with what to do."""

    path: int
    from_mm: float
    to_mm: float
    reason: str

    @property
    def length_mm(self) -> float:
        """Along the path."""
        return self.to_mm - self.from_mm


def check_gaps(gaps: Sequence[Gap], paths: Sequence[WrittenPath]) -> None:
    """Refuse gaps that aren't on the paths.

    Raises
    ------
    MendError
        For a path that the job hasn't written, a stretch that isn't on it, or shares beyond 0..1.
    """
    for gap in gaps:
        if not 0 <= gap.path < len(paths):
            raise MendError(
                f"a gap of path {gap.path}, and {len(paths)} are written: look again at this mark"
            )
        length = paths[gap.path].length_mm
        if not 0 <= gap.from_mm < gap.to_mm <= length + 1e-6:
            raise MendError(
                f"a gap from {gap.from_mm:g} to {gap.to_mm:g} mm isn't on path {gap.path}, "
                f"{length:.3f} mm long"
            )
        if not (0 < gap.missing <= 1 and 0 < gap.flow < np.inf):
            raise MendError(
                f"a gap with {gap.missing:g} of its ink missing, at {gap.flow:g} of its flow; give "
                "a share above 0 up to 1, and a factor above 0"
            )


def merge_gaps(gaps: Sequence[Gap], paths: Sequence[WrittenPath], widths: float) -> list[Gap]:
    """Join gaps of one path that lie nearer to each other than so many widths of the line.

    Gaps of different kinds (whole and thin) stay apart, cut where they overlap.
    """
    joined: list[Gap] = []
    for gap in sorted(gaps, key=lambda one: (one.path, one.from_mm, one.to_mm)):
        if not joined or joined[-1].path != gap.path:
            joined.append(gap)
            continue
        last = joined[-1]
        near = widths * paths[gap.path].usual_width(last.to_mm, max(gap.from_mm, last.to_mm))
        if last.whole == gap.whole and gap.from_mm - last.to_mm < near:
            joined[-1] = replace(
                last, to_mm=max(last.to_mm, gap.to_mm), flow=max(last.flow, gap.flow),
                missing=float(np.average(
                    [last.missing, gap.missing], weights=[last.length_mm, gap.length_mm]
                )),
            )  # fmt: skip
        elif gap.from_mm < last.to_mm < gap.to_mm:
            joined.append(replace(gap, from_mm=last.to_mm))
        elif gap.to_mm > last.to_mm:
            joined.append(gap)
    return joined


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
        """Return the top of the highest ink, mm; -inf without any."""
        above = 0.0 if layered else self.width_mm / 2
        return float((np.maximum(self.start[:, 2], self.end[:, 2]) + above).max(initial=-np.inf))

    def where(self, rows: BoolArray) -> LaidInk:
        """Return the pieces of a mask."""
        return LaidInk(*(getattr(self, one.name)[rows] for one in fields(self)))

    def nearest(self, places: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the piece whose axis is nearest to each place, (m,), and its distance, mm."""
        piece, away = np.zeros(len(places), np.int64), np.full(len(places), np.inf)
        if not len(self):
            return piece, away
        step = self.end - self.start
        square = np.maximum((step**2).sum(axis=1), 1e-18)
        for k, place in enumerate(places):
            share = np.clip(((place - self.start) * step).sum(axis=1) / square, 0.0, 1.0)
            gap = np.linalg.norm(self.start + share[:, None] * step - place, axis=1)
            piece[k] = gap.argmin()
            away[k] = gap[piece[k]]
        return piece, away


def laid_ink(paths: Sequence[WrittenPath], gaps: Sequence[Gap] = ()) -> LaidInk:
    """Return all ink of paths, but for what is missing in gaps (thin stretches count as ink)."""
    nothing = np.zeros((0, 3))
    parts = [LaidInk(nothing, nothing, np.zeros(0), np.zeros(0), np.zeros(0, np.int64))]
    parts += [_stretch(path, *span) for path in paths for span in _sound_spans(path, gaps)]
    return LaidInk(
        *(np.concatenate([getattr(one, item.name) for one in parts]) for item in fields(LaidInk))
    )


def _stretch(path: WrittenPath, from_mm: float, to_mm: float) -> LaidInk:
    cuts = path.cuts(from_mm, to_mm)
    piece, points = path.piece((cuts[:-1] + cuts[1:]) / 2), path.at(cuts)
    number = np.full(len(piece), path.number, dtype=np.int64)
    return LaidInk(points[:-1], points[1:], path.width_mm[piece], path.height_mm[piece], number)


def _sound_spans(path: WrittenPath, gaps: Sequence[Gap]) -> list[tuple[float, float]]:
    """Return the stretches of a path outside its whole gaps, mm along it."""
    spans, begin = [], 0.0
    own = sorted((g.from_mm, g.to_mm) for g in gaps if g.path == path.number and g.whole)
    for low, high in [*own, (path.length_mm, np.inf)]:
        if low > begin:
            spans.append((begin, low))
        begin = max(begin, high)
    return spans


def width_with_more(
    width_mm: FloatArray, height_mm: FloatArray, times: FloatArray, held_print: HeldPrint
) -> FloatArray:
    """Return the width of lines with so many times their ink (2 on a sound line), (m,), mm.

    A line of a layer stands no higher under the needle, so more ink goes to its sides, as the bead
    model says of it.
    """
    if not held_print.layered:
        return width_mm * np.sqrt(times)
    return held_print.ink.bead_section.width(
        times * section_mm2(width_mm, height_mm, held_print), height_mm
    )


def section_mm2(width_mm: FloatArray, height_mm: FloatArray, held_print: HeldPrint) -> FloatArray:
    """Return the cross-section of lines as they are dosed, (m,), mm²."""
    if not held_print.layered:
        return np.pi / 4 * (width_mm / (held_print.ink.swell_factor or 1.0)) ** 2
    return held_print.ink.bead_section.area(width_mm, height_mm)
