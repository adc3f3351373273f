"""Tell lines that touch their neighbours and are too thin, by bath that shows at their seams.

Lines that touch merge at their edges, so that no width is told of them (`widths`). What can be told
is how much of the way from a line's middle to its seams, half a pitch aside, is ink: the mean level
of that way over the level of the middle is a share that neither changes with the light nor, much,
with blur. Round lines of translucent ink have a valley at a sound seam as well: each layer is held
against what is usual in itself, so that a layer that is too thin throughout isn't told.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import ndtr

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.ink.ink_image import ACROSS
from registration.inspection.ink.presence import spread_of, widened
from registration.inspection.pictures.working import Mask
from registration.inspection.values import FloatImage, Gap, Stretch
from registration.inspection.ways import Ways, stretches_of

_MIDDLE: Final = 0.15
"""Of a width, to either side, that is a line's middle."""
_WIDTHS: Final = 0.5
"""Of a width, to a part of a line."""
_WINDOW: Final = 6
"""Parts of a line together."""
_LEAST: Final = 0.7
"""Of a part, that must be told."""
_LEAST_INK: Final = 0.5
"""Level of a middle that may be less than usual, being a gap's."""
_SLANT: Final = 0.1
"""Light from the side, from which on valleys between lines are of the light."""
_FEWEST: Final = 12
"""Windows from which what is usual is learned."""
_USUAL: Final = 80.0
"""Percentile of all windows, that is sound ink's even where much is thin."""
_ROUNDS: Final = 5
_SURE: Final = 4.0
"""Standard deviations beyond the tolerance."""
_MUCH: Final = 0.5
"""Of sound ink's share: what is told only where there is less isn't worth telling."""
_SOME: Final = 0.3
"""Of sound ink: what shows more is thin, and no gap."""
_TURN: Final = 6.0
"""Widths of a way between two thin stretches, that nothing is told of and is thin as well."""
_OFF: Final = 0.25
"""Of ink's level, that bath may be off."""
_SOME_OFF: Final = 0.003
"""Of a picture."""
_LEAST_USUAL: Final = 0.7
"""Share of a sound layer: flat lines have 1, round ones of translucent ink a quarter of pi."""


@dataclass(frozen=True)
class SeamLevels:
    """How much ink lies between lines' middles and their seams.

    Attributes
    ----------
    share : (n,) float64
        Of ink over sound ink, at each place; NaN where it isn't told.
    thin : (n,) bool
        Places of stretches that lack surely more than is tolerated.
    told : (n,) bool
        Places at which a stretch that lacks half of its ink would be.
    u : float
        Standard uncertainty of a stretch's share.
    """

    share: FloatArray
    thin: BoolArray
    told: BoolArray
    u: float

    def thins(self, gap: Gap, ways: Ways, present: FloatArray) -> bool:
        """Whether a gap is thin ink: some is ``present`` in the middle of the line, (n,)."""
        own = (ways.stroke == gap.stroke) & (ways.along > gap.from_mm) & (ways.along < gap.to_mm)
        thin = own & self.thin
        return bool(2 * thin.sum() > own.sum() and present[thin].mean() > _SOME)

    def near(self, ways: Ways) -> BoolArray:
        """Places in thin stretches and some widths around them, (n,)."""
        out = self.thin.copy()
        for first, last in stretches_of(self.thin, ways.run):
            reach = round(_TURN * float(ways.width[first]) / float(ways.step[first]))
            own = slice(max(0, first - reach), last + reach + 1)
            out[own] |= ways.run[own] == ways.run[first]
        return out

    def stretches(self, ways: Ways) -> tuple[Stretch, ...]:
        """Return what is too thin, by strokes."""
        out = []
        for first, last in stretches_of(self.thin, ways.run):
            if not np.isfinite(self.share[first : last + 1]).any():
                continue
            share = float(np.nanmean(self.share[first : last + 1]))
            begin, end = (
                float(ways.along[k] + w * ways.step[k] / 2) for k, w in ((first, -1), (last, 1))
            )
            p_value = float(ndtr((share - 1.0) / max(self.u, 1e-9)))
            out.append(Stretch("thin", int(ways.stroke[first]), begin, end, share, self.u, p_value))
        return tuple(out)


def seam_levels(
    profiles: FloatArray,
    good: BoolArray,
    ways: Ways,
    slant: float,
    tolerance: float,
    disturbed: bool,
) -> SeamLevels | None:
    """Judge the seams of lines that touch; None where they don't tell of half the ink.

    Parameters
    ----------
    profiles : (n, 61) float64
        Across all places; bath 0, ink 1, linear in light: ink that is told by its level.
    good : (n,) bool
        Places over bath that are seen.
    ways : Ways
    slant : float
        Of light from the side.
    tolerance : float
        Share of its ink that a line may lack.
    disturbed : bool
        Whether what is taken for light may be another thing's.
    """
    judged = good & straight_seams(ways)
    if slant > _SLANT or not judged.any():
        return None
    level = _to_seams(profiles, ways)
    middle = profiles[:, np.abs(ACROSS) <= _MIDDLE + 1e-9].mean(axis=1)
    part = _parts(ways)
    ink, top = (_means(one, judged, part) for one in (level, middle))
    run = ways.run[np.unique(part, return_index=True)[1]]
    both = _over_usual(ink, top, run, tolerance)
    if both is None:
        return None
    share: FloatArray = np.maximum(*both) if disturbed else both[0]
    window = _window_means(share, run)
    known = np.isfinite(window)
    usual, spread = _usual(window[known], tolerance)
    least = usual * (1.0 - tolerance) - _SURE * spread
    if least < _MUCH:
        return None
    each = _window_means((share < 0.5 * (usual + least)).astype(np.float64), run)
    low = known & (np.nan_to_num(window) < least) & (_WINDOW * each > _WINDOW - 1.5)
    thin, told = (_around(one, run) & np.isfinite(share) for one in (low, known))
    by_level = ink / np.median(ink[told & ~thin])
    of_sound = np.minimum(np.minimum(*both), by_level)
    at_places = _with_turns(thin[part], told[part], ways)
    return SeamLevels(of_sound[part], at_places, told[part], spread / usual)


def _over_usual(
    ink: FloatArray, top: FloatArray, run: IntArray, tolerance: float
) -> tuple[FloatArray, FloatArray] | None:
    """Share of ink of each part by the ratio to its middle, and by its valley, over usual ones.

    Blur lessens a valley, not the ratio; light that is off by a step changes the ratio alone.
    """
    ratio = ink / np.maximum(top, _LEAST_INK)
    windows = _window_means(ratio, run)
    known = windows[np.isfinite(windows)]
    if len(known) < _FEWEST:
        return None
    usual, _ = _usual(known, tolerance)
    sound = ratio > (1.0 - tolerance) * usual
    if usual < _LEAST_USUAL or sound.sum() < _FEWEST:
        return None
    valley = top - ink
    deeper = (valley - np.median(valley[sound])) / np.median(ink[sound])
    return ratio / usual, 1.0 - deeper


def is_disturbed(level: FloatImage, free: Mask, lost: BoolArray) -> bool:
    """Whether a picture shows more than ink and bath: a needle or glare pulls the fitted light.

    Parameters
    ----------
    level : (h, w) float32
        Bath 0, ink 1.
    free : (h, w) uint8
        Where there is bath alone.
    lost : (h, w) bool
        Strange or saturated.
    """
    off = np.abs(level[free > 0]) > _OFF
    return bool(lost.mean() > _SOME_OFF or (len(off) and off.mean() > _SOME_OFF))


def straight_seams(ways: Ways) -> BoolArray:
    """Places along straight ways that touch a line beside them, (n,)."""
    touching = np.isfinite(ways.seams).any(axis=0)
    ends = ways.to_end > 0.6 * ways.width
    return np.asarray(touching & ends & ~ways.corners() & ~ways.crossed)


def _to_seams(profiles: FloatArray, ways: Ways) -> FloatArray:
    """Mean level from the middle to the seams, (n,); NaN without."""
    total, count = np.zeros(len(profiles)), np.zeros(len(profiles))
    for way, seam in zip((1.0, -1.0), ways.seams, strict=True):
        zone = (way * ACROSS >= 0) & (way * ACROSS <= np.nan_to_num(seam)[:, None] + 1e-9)
        own = np.isfinite(seam)
        total += own * np.where(zone, profiles, 0.0).sum(axis=1) / zone.sum(axis=1)
        count += own
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(total / count)


def _parts(ways: Ways) -> IntArray:
    """Part of its line that each place belongs to, (n,)."""
    size = np.maximum(1, np.rint(_WIDTHS * ways.width / ways.step)).astype(np.int64)
    begin = np.flatnonzero(np.diff(ways.run, prepend=-1) != 0)
    number = np.arange(len(ways)) - np.repeat(begin, np.diff(np.append(begin, len(ways))))
    new = number % size == 0
    return np.asarray(np.cumsum(new) - 1, dtype=np.int64)


def _means(values: FloatArray, use: BoolArray, part: IntArray) -> FloatArray:
    """Means over the used places of each part, (m,); NaN where too few are used."""
    number, whole = np.bincount(part, use), np.bincount(part)
    total = np.bincount(part, np.where(use, values, 0.0))
    return np.where(number > _LEAST * whole, total / np.maximum(number, 1), np.nan)


def _window_means(values: FloatArray, run: IntArray) -> FloatArray:
    """Means over windows from each part on, (m,); NaN where one isn't of one line, or not told."""
    out = np.full(len(values), np.nan)
    if len(values) >= _WINDOW:
        same = run[_WINDOW - 1 :] == run[: 1 - _WINDOW]
        means = np.convolve(values, np.ones(_WINDOW) / _WINDOW, "valid")
        out[: 1 - _WINDOW] = np.where(same, means, np.nan)
    return out


def _around(low: BoolArray, run: IntArray) -> BoolArray:
    """Parts of the windows that begin at ``low`` ones, (m,)."""
    out = np.zeros_like(low)
    for first, last in stretches_of(low, run):
        out[first : last + _WINDOW] = True
    return out


def _with_turns(thin: BoolArray, told: BoolArray, ways: Ways) -> BoolArray:
    """Thin places, (n,), and the turns between them, at which nothing is told."""
    out = thin.copy()
    for first, last in stretches_of(~told, ways.run):
        inner = first > 0 and last < len(ways) - 1
        inner = inner and ways.run[first - 1] == ways.run[first] == ways.run[last + 1]
        if inner and thin[first - 1] and thin[last + 1]:
            short = float(ways.step[first : last + 1].sum()) < _TURN * float(ways.width[first])
            out[first : last + 1] |= short
    return out


def _usual(means: FloatArray, tolerance: float) -> tuple[float, float]:
    """What sound ink shows, and its standard deviation by what lies above: thin ink lies below."""
    usual, spread = float(np.percentile(means, _USUAL)), np.inf
    for _ in range(_ROUNDS):
        near = min(spread * _SURE, usual * tolerance)
        sound = means[means > usual - near]
        usual = float(np.median(sound))
        above = sound[sound > usual] - usual
        if not len(above):
            return usual, 0.0
        spread = widened(spread_of(np.concatenate([above, -above])), len(above))
    return usual, spread
