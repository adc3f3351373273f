"""Find stretches of strokes of which a picture tells nothing, long enough to hide a clog."""

from __future__ import annotations

from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.gaps.gaps import find_gaps, inside
from registration.inspection.ink.presence import INK
from registration.inspection.options import SeeingOptions
from registration.inspection.seen_layer import SeenLayer
from registration.inspection.unseen.standing_ink import standing_ink
from registration.inspection.values import Gap, Unseen
from registration.inspection.ways import Ways, stretches_of

_DOUBTED: Final = 1.5
"""Tolerated gaps, from which on a stretch that looks bare is told of, though debris lies by."""
_LACKING: Final = 1.25
"""The same where bath shows beside what hides the rest, as at a joint with older ink."""
_SHORT: Final = 0.5
"""Of a vessel, of which no more may go untold, however short it is."""
_LEAST: Final = 0.2
"""Of the longest stretch that may go untold in any case: whoever lets pass more isn't asked."""
_LIKELIER: Final = 30.0
"""Times a gap's p-value, up to which a stretch in faint ink is asked about."""
_HIDING: Final = (Unseen.GLARE, Unseen.HIDDEN)
_SEEN_MM: Final = 0.3
"""A seen stretch that is shorter, between two that aren't, doesn't part them."""


def unseen_ways(
    look: SeenLayer,
    why: IntArray,
    gaps: list[Gap],
    doubted: list[Gap],
    gap_mm: float,
    longest_mm: float,
    rate: float,
) -> tuple[Gap, ...]:
    """Return stretches longer than ``longest_mm`` in which ink might be missing untold.

    Of vessels shorter than twice that half counts. They have the form of gaps, with p-values of 1.
    Ink that is too faint for a tolerated gap, but not for one of that length, isn't told of here,
    nor is what plainly shows older filaments' ink. Shorter ones count where ink doesn't show, and
    only what lies around keeps them from being gaps, where a glint or another thing hides what
    lies beside a found gap, and where a volume shows bath before and behind them.

    Parameters
    ----------
    look : SeenLayer
    why : (n,) int64
        `Unseen`.
    gaps : list of Gap
        Found ones, of which nothing more need be told.
    doubted : list of Gap
        Stretches that look bare and might yet be so by noise.
    gap_mm, longest_mm : float, mm
        Tolerated gap; longest stretch that may go untold.
    rate : float
        False findings per sound layer.
    """
    ways = look.ways
    most = _most_untold(ways, gap_mm, longest_mm)
    standing, lacking, glints = standing_ink(look, why, np.random.default_rng(31))
    told = (why == Unseen.SEEN) | (_told_when_long(look, why, most, rate) & ~glints)
    told = (told | standing) & ~(lacking & ~(look.present > INK))
    doubtful = inside(doubted, ways) & ~standing
    told = (told & ~doubtful) | inside(gaps, ways)
    for first, last in stretches_of(told, ways.run):
        between = first > 0 and last < len(ways) - 1
        between = between and ways.run[first - 1] == ways.run[first] == ways.run[last + 1]
        if between and _length(ways, first, last) < _SEEN_MM:
            told[first : last + 1] = False
    out = []
    bare = (look.present < INK) & ~inside(gaps, ways)
    low = ((why == Unseen.UNCLEAR) & ~(look.present > INK)) | doubtful
    for first, last in stretches_of(~told, ways.run):
        own = slice(first, last + 1)
        low_mm = float(ways.step[own][low[own]].sum())
        lacking_mm = float(ways.step[own][lacking[own] & ~(look.present[own] > INK)].sum())
        hides = np.isin(why[own], _HIDING)
        beside_mm = float(ways.step[own][hides].sum()) * _is_beside(ways, first, last, gaps)
        bare_first, bare_last = _with_bare_sides(bare, ways, first, last)
        if look.work.is_scatter and bare_first < first and last < bare_last:
            first, last, lacking_mm = bare_first, bare_last, np.inf  # a gap runs below another line
        doubt = max(low_mm, beside_mm) > _DOUBTED * gap_mm or lacking_mm > _LACKING * gap_mm
        if _length(ways, first, last) > most[first] or doubt:
            (begin, start), (end, stop) = _edge(ways, first, -0.5), _edge(ways, last, 0.5)
            out.append(Gap(int(ways.stroke[first]), begin, end, start, stop, 0.0, 1.0))
    return tuple(out)


def _with_bare_sides(bare: BoolArray, ways: Ways, first: int, last: int) -> tuple[int, int]:
    """First and last place of a stretch with the bare ones before and behind it."""
    run = ways.run
    while first > 0 and run[first - 1] == run[first] and bare[first - 1]:
        first -= 1
    while last < len(run) - 1 and run[last + 1] == run[last] and bare[last + 1]:
        last += 1
    return first, last


def _is_beside(ways: Ways, first: int, last: int, gaps: list[Gap]) -> bool:
    """Whether a gap ends where a stretch begins, or begins where it ends."""
    own = [gap for gap in gaps if gap.stroke == ways.stroke[first]]
    begin, end = float(ways.along[first]), float(ways.along[last])
    return any(
        abs(gap.to_mm - begin) < _SEEN_MM or abs(gap.from_mm - end) < _SEEN_MM for gap in own
    )


def _most_untold(ways: Ways, gap_mm: float, longest_mm: float) -> FloatArray:
    """Longest stretch around each place that may go untold, (n,), mm: of a short vessel half."""
    whole: FloatArray = np.zeros(len(ways))
    for stroke in np.unique(ways.stroke):
        own = ways.stroke == stroke
        whole[own] = float((ways.along + 0.5 * ways.step)[own].max())
    least = min(max(2.0 * gap_mm, _LEAST * longest_mm), longest_mm)
    return np.clip(_SHORT * whole, least, longest_mm)


def _told_when_long(look: SeenLayer, why: IntArray, most_mm: FloatArray, rate: float) -> BoolArray:
    """Places too faint for short gaps, at which one of ``most_mm`` (n,) would be found, (n,)."""
    bath, faint = look.bath, why == Unseen.FAINT
    if bath is None or bath.noise is None or not bath.faint:
        return np.zeros(len(why), dtype=np.bool_)
    judged = faint & ~look.over_old & (bath.why == Unseen.SEEN)
    way_mm = float(look.ways.step[judged].sum())
    for length in np.unique(most_mm[judged]).tolist():
        if not bath.noise.can_tell(length, rate / max(1.0, way_mm / length)):
            judged &= most_mm != length
    return judged


def _length(ways: Ways, first: int, last: int) -> float:
    return float(ways.step[first : last + 1].sum())


def _edge(ways: Ways, row: int, by: float) -> tuple[float, tuple[float, float]]:
    """Where a place begins or ends: along its stroke, and as a place, mm."""
    far = by * float(ways.step[row])
    ahead: FloatArray = np.array([ways.normal[row, 1], -ways.normal[row, 0]])
    x, y = ways.point[row, :2] + far * ahead
    return float(ways.along[row]) + far, (float(x), float(y))


def doubted_gaps(
    look: SeenLayer, gaps: list[Gap], places: int, options: SeeingOptions
) -> list[Gap]:
    """Stretches that look bare in faint ink, too likely by noise to be gaps."""
    told = look.bath
    if told is None or told.noise is None or not told.faint:
        return []
    around = np.zeros(len(look.ways))
    clear = ~look.over_old & (told.why == Unseen.SEEN)
    likely = _LIKELIER * options.false_rate / places
    found, _ = find_gaps(
        look.present, clear, look.inferred, look.ways, told.noise, options.gap_mm, likely, around,
        True,
    )  # fmt: skip
    return [one for one in found if one not in gaps]
