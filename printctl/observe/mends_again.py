"""Treat mended gaps as fresh ink of their original paths when the next picture is judged.

A mend may fail as a line does: the needle is still clogged, the ink doesn't stick. At the next
look, in layers if little lies above by then, the gap's part of its path counts as fresh ink, in
place of the lines that mended it, which overlap what was sound. Sound ink beside it ends with a
round tip at the gap, and some of it is judged with a short gap, which has too few places alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import IntArray
from printctl.observe.expected import ExpectedInk
from printctl.observe.look_values import Look
from printctl.observe.mending.gap import Gap as MendGap
from printctl.observe.mending.gap import NotMended
from printctl.observe.mending.laid_ink import LaidInk, sound_spans, stretch_of
from printctl.observe.records import LookRecord
from registration.inspection import ExpectedLines, Gap, LayerFindings, Stations

MOST_TRIES: Final = 2
_FIRST: Final = 1_000_000
"""Number of the stroke that stands for the first mended gap: no job has so many paths."""
_LEVEL_MM: Final = 1e-3
_SAME_MM: Final = 0.05
_SHORT_MM: Final = 1.5
_BESIDE_MM: Final = 0.6
"""Of a path, to either side of a gap below `_SHORT_MM`, that is judged with it."""
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

    @property
    def begin_mm(self) -> float:
        """Where the stroke that stands for it begins, along the path."""
        return max(0.0, self.from_mm - self._beside_mm)

    @property
    def end_mm(self) -> float:
        """Where that ends, if the path goes on for so long."""
        return self.to_mm + self._beside_mm

    @property
    def _beside_mm(self) -> float:
        return _BESIDE_MM if self.to_mm - self.from_mm < _SHORT_MM else 0.0


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
        gaps = [MendGap(one.path, one.begin_mm, one.end_mm) for one in own if one.path == path]
        fresh = bool(layer.lines.fresh[layer.lines.stroke == path].any())
        for low, high in sound_spans(ink.paths[path], gaps):
            # Lines are drawn with round ends.
            tip = 0.5 * float(ink.width_mm[ink.stroke == path].max())
            begin = low + tip * (low > 0.0)
            end = high - tip * (high < ink.paths[path].length_mm)
            if end - begin > _SAME_MM:
                parts.append(_part(ink, path, begin, end, number=path, fresh=fresh))
    for k, one in enumerate(own):
        end = min(one.end_mm, ink.paths[one.path].length_mm)
        parts.append(_part(ink, one.path, one.begin_mm, end, number=_FIRST + k, fresh=True))
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
        low, high = one.begin_mm + gap.from_mm, one.begin_mm + gap.to_mm
        high = high if one.end_mm > one.to_mm else min(high, one.to_mm)
        if min(high, one.to_mm) - max(low, one.from_mm) > _SAME_MM:
            own_gaps.append(replace(gap, stroke=one.path, from_mm=low, to_mm=high))
    return tuple(own_gaps)


def of_mends(findings: LayerFindings) -> LayerFindings:
    """Return findings on mends alone."""
    gaps = tuple(one for one in findings.gaps if one.stroke >= _FIRST)
    return replace(findings, gaps=gaps, stretches=())


def unseen_words(findings: LayerFindings, mended: Sequence[Mended]) -> str:
    """Say how much of what was mended isn't seen, where that is half of it or more; else empty."""
    stations, unseen_mm = findings.stations, 0.0
    for k, one in enumerate(mended):
        along = stations.along_mm + one.begin_mm
        own = (stations.stroke == _FIRST + k) & (along > one.from_mm) & (along < one.to_mm)
        unseen_mm += float(stations.length_mm[own & ~stations.seen].sum())
    whole_mm = sum(one.to_mm - one.from_mm for one in mended)
    if not mended or 2 * unseen_mm < whole_mm:
        return ""
    unseen_mm = min(unseen_mm, whole_mm)  # stations at an end reach a little over it
    return f"{unseen_mm:.2f} of {whole_mm:.2f} mm that were mended can't be seen: look yourself"


def writes_since(ink: ExpectedInk, look: Look) -> bool:
    """Whether the job wrote anything since the look before."""
    return bool((ink.between(look.before, look.done) & ~ink.inserted).any())


def last_mends(looks: Sequence[LookRecord], look: Look) -> tuple[tuple[Mended, ...], int]:
    """Return what the last look that was judged had written again, and since when it judged."""
    earlier = [one for one in looks if one.judged and one.done < look.done]
    if not earlier:
        return (), 0
    found = earlier[-1].found
    return tuple(Mended(**one) for one in found.get("mended", ())), int(found.get("about_from", 0))


def without_mends(stations: Stations) -> Stations:
    """Return the places along what was written for the first time."""
    own = stations.stroke < _FIRST
    each = {item.name: getattr(stations, item.name) for item in fields(Stations)}
    kept: dict[str, Any] = {name: None if one is None else one[own] for name, one in each.items()}
    return Stations(**kept)


def tries_of(gap: MendGap, mended: Sequence[Mended]) -> int:
    """How often a gap, or a part of it, was mended before."""
    each = (
        one.tries
        for one in mended
        if one.path == gap.path
        and min(one.to_mm, gap.to_mm) - max(one.from_mm, gap.from_mm) > _SAME_MM
    )
    return max(each, default=0)


def left_in_vain(gap: MendGap) -> NotMended:
    """Say why a gap that was written `MOST_TRIES` times isn't written again unasked."""
    why = (
        f"written {MOST_TRIES} times more, and no ink lies there; see to needle and bath, then "
        "approve to have it written once more"
    )
    return NotMended(gap.path, gap.from_mm, gap.to_mm, why)
