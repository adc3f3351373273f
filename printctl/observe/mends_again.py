"""Treat mended gaps as fresh ink of their original paths when the next picture is judged.

A mend may fail as a line does: the needle is still clogged, the ink doesn't stick. At the next
look, in layers if little lies above by then, the gap's part of its path counts as fresh ink, in
place of the lines that mended it, which overlap what was sound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from printctl.observe.expected import ExpectedInk
from printctl.observe.mending.gap import Gap as MendGap
from printctl.observe.mending.laid_ink import LaidInk, sound_spans, stretch_of
from registration.layer_images import ExpectedLines, Gap, Stations

IntArray = NDArray[np.int64]

MOST_TRIES: Final = 2
_FIRST: Final = 1_000_000
"""Number of the stroke that stands for the first mended gap: no job has so many paths."""
_LEVEL_MM: Final = 1e-3
_SAME_MM: Final = 0.05
_BEGUN: Final = 0.5
"""Way above a level over the level's own, below which most of it lies bare."""


@dataclass(frozen=True)
class Mended:
    """Gap that was written again.

    Attributes
    ----------
    path : int
    from_mm, to_mm : float, mm
        Along it.
    tries : int
        How often.
    """

    path: int
    from_mm: float
    to_mm: float
    tries: int = 1


@dataclass(frozen=True)
class LayerInk:
    """Ink that a look is about.

    Attributes
    ----------
    lines : ExpectedLines
        The judged ones and those below.
    row : (n,) int64
        Of the expected ink, of each.
    mended : tuple of Mended
        Gaps that are looked at again; in ``lines`` their strokes are numbered from a million.
    """

    lines: ExpectedLines
    row: IntArray
    mended: tuple[Mended, ...] = ()


def with_mends(
    layer: LayerInk, ink: ExpectedInk, mended: Sequence[Mended], before: int
) -> LayerInk:
    """Return ink in which gaps mended at the last look are fresh, as far as they can be seen.

    Parameters
    ----------
    layer : LayerInk
    ink : ExpectedInk
    mended : sequence of Mended
    before : int
        Command at which the last look held the print: its mend follows.
    """
    own = tuple(one for one in mended if _is_open(one, layer, ink))
    if not own:
        return layer
    cut = {one.path for one in own}
    kept = ~np.isin(layer.lines.stroke, sorted(cut))
    kept &= ~(ink.inserted[layer.row] & _mended_again(own, layer, ink, before))
    parts = [_some(layer, kept)]
    for path in sorted(cut):
        gaps = [MendGap(one.path, one.from_mm, one.to_mm) for one in own if one.path == path]
        for span in sound_spans(ink.paths[path], gaps):
            parts.append(_part(ink, path, *span, number=path, fresh=False))
    for k, one in enumerate(own):
        parts.append(_part(ink, one.path, one.from_mm, one.to_mm, number=_FIRST + k, fresh=True))
    lines = ExpectedLines(
        **{
            item.name: np.concatenate([getattr(part.lines, item.name) for part in parts])
            for item in fields(ExpectedLines)
        }
    )
    return LayerInk(lines, np.concatenate([part.row for part in parts]), own)


def _mended_again(
    own: Sequence[Mended], layer: LayerInk, ink: ExpectedInk, before: int
) -> NDArray[np.bool_]:
    """Which lines are where those lie that mended these gaps: in layers, from their level up."""
    if ink.style == "embedded":
        return np.asarray(ink.command[layer.row] >= before)
    levels = [ink.paths[one.path].points[0, 2] for one in own]
    return np.asarray(layer.lines.end[:, 2] > min(levels) - _LEVEL_MM)


def _is_open(one: Mended, layer: LayerInk, ink: ExpectedInk) -> bool:
    """Whether a mend can be seen; in a bath older ink above it hides no more than of a vessel."""
    if ink.style == "embedded":
        return True
    return _is_bare(float(ink.paths[one.path].points[0, 2]), layer, ink)


def _is_bare(z_mm: float, layer: LayerInk, ink: ExpectedInk) -> bool:
    """Whether a level is the topmost one, or the one above has but begun."""
    fresh = layer.lines.end[layer.lines.fresh, 2]
    if not len(fresh):
        return False
    if abs(z_mm - fresh.max()) < _LEVEL_MM:
        return True
    length = np.linalg.norm(ink.end - ink.start, axis=1)
    level = np.abs(ink.end[:, 2] - z_mm) < _LEVEL_MM
    above = ink.end[:, 2] > z_mm + _LEVEL_MM
    return float(length[above].sum()) < _BEGUN * float(length[level].sum())


def _some(layer: LayerInk, rows: NDArray[np.bool_]) -> LayerInk:
    chosen = {item.name: getattr(layer.lines, item.name)[rows] for item in fields(ExpectedLines)}
    return LayerInk(ExpectedLines(**chosen), layer.row[rows])


def _part(
    ink: ExpectedInk, path: int, low: float, high: float, *, number: int, fresh: bool
) -> LayerInk:
    laid: LaidInk = stretch_of(ink.paths[path], low, high)
    cuts = ink.paths[path].cuts(low, high, least_mm=0.0)
    piece = ink.paths[path].piece((cuts[:-1] + cuts[1:]) / 2)
    row = int(np.searchsorted(ink.stroke, path)) + piece
    full = np.ones(len(row), dtype=np.int64)
    lines = ExpectedLines(
        laid.start, laid.end, ink.width_mm[row], ink.command[row], number * full, full > 1 - fresh
    )
    return LayerInk(lines, row)


def mended_of(stroke: int, mended: Sequence[Mended]) -> Mended | None:
    """Return the mended gap that a stroke stands for; None for one of the job's own paths."""
    return None if stroke < _FIRST else mended[stroke - _FIRST]


def gaps_of_job(gaps: Sequence[Gap], mended: Sequence[Mended]) -> tuple[Gap, ...]:
    """Return gaps on the job's own paths, those in mends included."""
    own_gaps = []
    for gap in gaps:
        one = mended_of(gap.stroke, mended)
        if one is None:
            own_gaps.append(gap)
            continue
        low, high = one.from_mm + gap.from_mm, one.from_mm + gap.to_mm
        own_gaps.append(replace(gap, stroke=one.path, from_mm=low, to_mm=min(high, one.to_mm)))
    return tuple(own_gaps)


def without_mends(stations: Stations) -> Stations:
    """Return the places along what was written for the first time."""
    own = stations.stroke < _FIRST
    return Stations(**{item.name: getattr(stations, item.name)[own] for item in fields(Stations)})


def tries_of(gap: MendGap, mended: Sequence[Mended]) -> int:
    """How often a gap, or a part of it, was mended before."""
    each = (
        one.tries
        for one in mended
        if one.path == gap.path
        and min(one.to_mm, gap.to_mm) - max(one.from_mm, gap.from_mm) > _SAME_MM
    )
    return max(each, default=0)
