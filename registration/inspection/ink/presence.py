"""Measure ink presence (bath 0, sound line 1) along lines, and its noise by window length.

The presence is a profile across the line, weighted by what sound lines look like: 1 for ink, 0 for
bath. Where bath is seen beside the line it is also taken against that bath, and the larger value
counts: light that changes from place to place mustn't look like missing ink.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from scipy.special import ndtr, ndtri

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.ink.ink_image import ACROSS, Template, angle_of
from registration.inspection.pictures.working import Mask
from registration.inspection.values import FloatImage
from registration.inspection.ways import Seen, Ways

INK: Final = 0.5
"""Presence above which there is ink."""
_SIDE = 0.15
"""Of a width: nearer than that to an edge a side isn't clear bath."""
_RIM_PX: Final = 2.0
"""Working pixels, by which a line that is drawn may be wider to a side than it is."""
_TAILS: Final = (0.02, 0.005)
_PILED: Final = 1.5
"""Times the scatter below the middle, that the one above counts for at most."""
_FEWEST = 16
_FEW: Final = 5.0
"""Spreads of n windows are widened by 1 + 5 / n."""
_FAKES = 400
_UNLEARNED = 1.5
"""Where there is no ink to learn from, it may scatter by so much more than its place does."""
WINDOWS: Final = (0.5, 1.0, 2.0, 4.0, 8.0)
"""Tolerated gaps."""
_ROUNDS: Final = 3
_RESIDUE: Final = 0.1
"""Of ink's presence, that a gap may show besides the bath's noise."""
_GROUND: Final = 0.05
"""Least scatter of bare ground, of ink's height: what is cut off below the layer has none."""
END: Final = 0.3
"""Of a width: so near to an end less ink is no sign."""


@dataclass(frozen=True)
class Sides:
    """Where the next ink is expected to either side of each place, (n,) expected widths; <= 1.5."""

    left: FloatArray
    right: FloatArray

    @staticmethod
    def of(seen: Seen, ways: Ways, lines: Mask, px_per_mm: float) -> Sides:
        """Look it up in a mask of all expected ink."""
        drawn = seen.profiles(lines, ways.width[:, None] * ACROSS, nearest=True) > 0
        px = 1.0 / (px_per_mm * ways.width)
        begin, rim = 0.5 + np.maximum(0.1, 1.2 * px), 0.5 + np.maximum(0.1, _RIM_PX * px)
        sides = []
        for way in (1, -1):
            u, ink = ACROSS[::way] * way, drawn[:, ::way]
            own = np.logical_and.accumulate(ink[:, len(u) // 2 :], axis=1)
            ends = own.sum(axis=1) * float(u[-1] - u[-2]) < rim  # another's ink would go on
            taken = ink & (u > begin[:, None])
            taken[:, len(u) // 2 :] &= ~(own & ends[:, None])
            sides.append(np.where(taken, u, 1.5).min(axis=1))
        return Sides(sides[0], sides[1])

    def usable(self) -> BoolArray:
        """Places across at which nothing but the line itself is expected, (n, 61)."""
        inner = np.abs(ACROSS) <= 0.5
        beyond = (self.left[:, None] - 0.1 > ACROSS) & (self.right[:, None] - 0.1 > -ACROSS)
        return np.asarray(inner | beyond)

    def levels(self, profiles: FloatImage, px_width: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean of the bath seen on the left and on the right, (n,) each; NaN where none is."""
        margin = _SIDE + 1.0 / px_width
        found = []
        for way, clear in ((1.0, self.left), (-1.0, self.right)):
            u = way * ACROSS
            zone = (u > 0.5 + margin[:, None]) & (u < np.minimum(clear - margin, 1.2)[:, None])
            count = zone.sum(axis=1)
            total = np.where(zone, profiles, 0.0).sum(axis=1)
            found.append(np.where(count >= 4, total / np.maximum(count, 1), np.nan))
        return found[0], found[1]


def presence(
    profiles: FloatImage, weights: FloatArray, left: FloatArray, right: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Presence of each profile (n, 61) given the bath beside it, and without that, (n,) each.

    ``weights`` are those of `Template.weights`; ``left`` and ``right`` are NaN where no bath is
    seen.
    """
    plain = (profiles * weights).sum(axis=1)
    side = np.where(np.isnan(left), right, np.where(np.isnan(right), left, 0.5 * (left + right)))
    beside = plain - side * weights.sum(axis=1)
    both = np.where(np.isnan(side), plain, np.maximum(plain, beside))
    return np.asarray(both, dtype=np.float64), np.asarray(plain, dtype=np.float64)


def fake_places(
    free: Mask, width_px: float, step_px: float, rng: np.random.Generator
) -> Seen | None:
    """Lines of eight places each where there is bath alone; pixels stand for mm."""
    depth = cv2.distanceTransform(free, cv2.DIST_L2, 3)
    y, x = np.nonzero(depth > 0.6 * width_px)
    if len(y) < _FEWEST:
        return None
    pick = rng.integers(0, len(y), _FAKES)
    angle = rng.uniform(0, 2 * np.pi, _FAKES)
    way = np.column_stack([np.cos(angle), np.sin(angle)])
    begin = np.column_stack([x[pick], y[pick]]).astype(np.float64)
    at = begin[:, None] + (np.arange(8)[None, :, None] - 3.5) * step_px * way[:, None]
    way = np.repeat(way, 8, axis=0)
    return Seen(at.reshape(-1, 2), np.column_stack([-way[:, 1], way[:, 0]]), way)


@dataclass(frozen=True)
class BySize:
    """Scatter of heights: of bare ground always the same, of ink in proportion to its height.

    Its inverse hyperbolic sine evens such scatter out (Huber et al. 2002, Bioinformatics 18, S96).

    Attributes
    ----------
    least : float
        Presence at which both scatter alike.
    spread : (k,) float64
        Standard deviation of evened presence, of the windows of a `WindowNoise`.
    """

    least: float
    spread: FloatArray

    def evened(self, presence: FloatArray) -> FloatArray:
        """Presence on a scale on which ink scatters as much everywhere."""
        return np.arcsinh(presence / self.least)


@dataclass(frozen=True)
class WindowNoise:
    """Scatter of the mean presence over windows of several lengths.

    Attributes
    ----------
    length_mm : (k,) float64, mm
    middle : float
        Usual presence of ink.
    spread : (k,) float64
        Standard deviation that stands for the tails, too.
    bath : float
        Of bath, over the shortest window that matters; 0 where it isn't known.
    bath_long : (length, spread), mm and presence
        Of bath over a longer window; (0, 0) where it isn't known.
    by_size : BySize or None
        Where ink scatters in proportion to itself.
    """

    length_mm: FloatArray
    middle: float
    spread: FloatArray
    bath: float
    bath_long: tuple[float, float] = (0.0, 0.0)
    by_size: BySize | None = None

    def p_value(self, mean: float, length_mm: float) -> float:
        """Chance of so low a mean over a stretch, by noise."""
        return float(self.p_values(np.array(mean), length_mm))

    def p_values(self, mean: FloatArray, length_mm: float) -> FloatArray:
        """The same of several means, (n,)."""
        spreads, ink = self.spread, np.array(self.middle)
        if self.by_size is not None:
            spreads = self.by_size.spread
            mean, ink = self.by_size.evened(mean), self.by_size.evened(ink)
        spread = float(np.interp(length_mm, self.length_mm, spreads))
        return np.asarray(ndtr((mean - ink) / max(spread, 1e-9)))

    def contrast(self, length_mm: float) -> float:
        """Ink over bath, in standard deviations of a stretch."""
        spread = float(np.interp(length_mm, self.length_mm, self.spread))
        return self.middle / max(float(np.hypot(spread, self.bath)), 1e-9)

    def can_tell(self, length_mm: float, p_needed: float) -> bool:
        """Whether a gap of that length would be found, nineteen times in twenty."""
        bare = _RESIDUE * self.middle + 1.64 * self._bath_over(length_mm)
        return self.p_value(bare, length_mm) < p_needed

    def _bath_over(self, length_mm: float) -> float:
        """Standard deviation of bath over a stretch."""
        long_mm, long = self.bath_long
        short_mm = float(self.length_mm[min(1, len(self.length_mm) - 1)])
        if not short_mm < long_mm or self.bath <= 0:
            return self.bath
        told = np.log([self.bath, min(long, self.bath)])
        return math.exp(np.interp(math.log(length_mm), np.log([short_mm, long_mm]), told))

    def at_least(self, times: float) -> WindowNoise:
        """Return it with no less scatter of ink than so many times that of bath."""
        bath = np.array([self._bath_over(float(length)) for length in self.length_mm])
        return replace(self, spread=np.maximum(self.spread, times * bath))


def window_means(
    values: FloatArray, good: BoolArray, run: IntArray, count: int, scattered: bool
) -> FloatArray:
    """Means over ``count`` neighbours of one run that are all good.

    Of ``scattered`` ones those between them that aren't good are left out.
    """
    if scattered:
        values, run, good = values[good], run[good], good[good]
    n = len(values)
    if n < count:
        return np.empty(0)
    total = np.concatenate([[0.0], np.cumsum(np.where(good, values, 0.0))])
    number = np.concatenate([[0], np.cumsum(good)])
    whole = (number[count:] - number[:-count] == count) & (run[count - 1 :] == run[: n - count + 1])
    return np.asarray((total[count:] - total[:-count])[whole] / count)


def window_noise(
    values: FloatArray,
    good: BoolArray,
    ways: Ways,
    bath_values: FloatArray | None,
    gap_mm: float,
    known: bool,
    even: bool,
    by_size: bool = False,
) -> WindowNoise | None:
    """Measure scatter; None where there is too little ink, unless ink's look is known.

    Missing ink lowers presence, so that the upper half of all values is that of ink; the lower half
    counts as far as it is ink at all. The tails are measured, not taken for normal. What scatters
    far more above the middle than below is more ink or debris, unless the measure is ``even``:
    edges and heights scatter to both sides alike. Heights of ink on bare ground scatter in
    proportion to themselves (``by_size``): lines 30 % lower than usual are no gaps, and no reason
    not to know a bare one.
    """
    step = float(np.median(ways.step))
    ink_values = values[good & (values > INK)]
    enough = len(ink_values) >= _FEWEST
    if not enough and not known:
        return None
    middle = float(np.median(ink_values)) if enough else 1.0
    least, times = (INK * middle, 1.0) if enough else (-np.inf, _UNLEARNED)
    lengths, spreads, inks = list[float](), list[float](), list[FloatArray]()
    for scattered in (False, True):  # between lines of older ink bath shows in few neighbours
        for size in WINDOWS:
            count = max(1, round(size * gap_mm / step))
            means = window_means(values, good, ways.run, count, scattered)
            ink = means[means > least]
            if len(ink) < _FEWEST:
                break
            lengths.append(count * step)
            spread = spread_of(ink, np.inf if even else _PILED)
            spreads.append(times * widened(spread, len(ink)))
            inks.append(ink)
        if spreads:
            break
    if not spreads:
        return None
    bath = 0.0 if bath_values is None else _bath_spread(bath_values, step, gap_mm)
    narrower: FloatArray = np.minimum.accumulate(np.array(spreads))
    sized = _by_size(inks, narrower, middle, bath) if by_size and enough else None
    return WindowNoise(np.array(lengths), middle, narrower, bath, by_size=sized)


def _by_size(inks: list[FloatArray], spread: FloatArray, middle: float, bath: float) -> BySize:
    """Scatter of ink's means, of each length, in proportion to themselves; found in rounds."""
    ground, share = max(bath, _GROUND * middle), float(spread[0]) / middle
    for _ in range(_ROUNDS):
        least = ground / share
        evened = [widened(spread_of(np.arcsinh(ink / least)), len(ink)) for ink in inks]
        share = max(evened[0], 1e-6)
    return BySize(least, np.minimum.accumulate(np.array(evened)))


def averaged(values: FloatArray, good: BoolArray, run: IntArray, count: int) -> FloatArray:
    """Means of good values over ``count`` neighbours of one run, fewer at ends; NaN for none."""
    n, half = len(values), count // 2
    begin = np.concatenate([[True], run[1:] != run[:-1]])
    first = np.maximum.accumulate(np.where(begin, np.arange(n), 0))
    last = np.minimum.accumulate(np.where(np.append(begin[1:], True), np.arange(n), n)[::-1])[::-1]
    low, high = np.maximum(np.arange(n) - half, first), np.minimum(np.arange(n) + half, last) + 1
    total = np.concatenate([[0.0], np.cumsum(np.where(good, values, 0.0))])
    number = np.concatenate([[0], np.cumsum(good)])
    with np.errstate(invalid="ignore"):
        return np.asarray((total[high] - total[low]) / (number[high] - number[low]))


def without_lows(
    values: FloatArray, good: BoolArray, ways: Ways, middle: float, length_mm: float
) -> BoolArray:
    """Good places whose surroundings, so long a stretch, show more ink than bath, (n,).

    The scatter of faint ink would else hold the steps of what is missing, as large as ink itself.
    """
    count = max(1, round(length_mm / float(np.median(ways.step)))) | 1
    around = averaged(values, good, ways.run, count)
    return np.asarray(good & ~(around < INK * middle))


def rougher(
    values: FloatArray, good: BoolArray, ways: Ways, bath: FloatArray, gap_mm: float
) -> float:
    """Return how much rougher lines are than bath, from a stretch to the next; 1 or more.

    The needle stirs the bath along its way. Steps where ink is missing are few, and don't count.
    """
    step = float(np.median(ways.step))
    count = min(4, max(1, round(gap_mm / step)))
    total = np.concatenate([[0.0], np.cumsum(np.where(good, values, 0.0))])
    number = np.concatenate([[0], np.cumsum(good)])
    n = len(values) - 2 * count
    if n < _FEWEST:
        return 1.0
    whole = number[2 * count :] - number[: -2 * count] == 2 * count
    whole &= ways.run[2 * count - 1 :] == ways.run[: n + 1]
    change = (total[2 * count :] - 2 * total[count:-count] + total[: -2 * count])[whole] / count
    lines = bath.reshape(-1, 8)[:, : 2 * count]
    own = lines[:, count:].mean(axis=1) - lines[:, :count].mean(axis=1)
    if len(change) < _FEWEST:
        return 1.0
    return max(1.0, float(np.median(np.abs(change)) / max(np.median(np.abs(own)), 1e-9)))


def long_bath(
    image: FloatImage,
    free: Mask,
    long_mm: float,
    px_per_mm: float,
    width_px: float,
    template: Template,
    least: float,
    rng: np.random.Generator,
) -> tuple[float, float]:
    """Return a length, mm, and the scatter of bath over it; (0, 0) where bath is too narrow.

    ``least`` is the presence of the faintest line's ink, which counts as 1.
    """
    found = fake_places(free, width_px, long_mm * px_per_mm / 8, rng)
    if found is None:
        return 0.0, 0.0
    weights, _ = template.weights(angle_of(found), None)
    level = (found.profiles(image, width_px * ACROSS[None, :]) * weights).sum(axis=1)
    inside = found.profiles(free, np.zeros((1, 1)), nearest=True)[:, 0] > 0
    lines = level.reshape(-1, 8)[inside.reshape(-1, 8).all(axis=1)]
    if len(lines) < _FEWEST:
        return 0.0, 0.0
    return long_mm, spread_of(lines.mean(axis=1)) / least


def _bath_spread(values: FloatArray, step: float, gap_mm: float) -> float:
    """Standard deviation of bath over a tolerated gap; eight places a line."""
    count = min(8, max(1, round(gap_mm / step)))
    return spread_of(values.reshape(-1, 8)[:, :count].mean(axis=1))


def widened(spread: float, count: int) -> float:
    """Return a spread that was measured in so few windows, with the doubt of that."""
    return spread * (1.0 + _FEW / count)


def spread_of(values: FloatArray, most_above: float = np.inf) -> float:
    """Standard deviation by the wider half, or by the tails where those are wider.

    What lies above the median counts up to ``most_above`` times what lies below.
    """
    middle = float(np.median(values))
    low, high = np.percentile(values, [15.87, 84.13])
    below, above = middle - low, high - middle
    for tail in _TAILS:
        if tail * len(values) >= 5:
            lower, upper = (np.quantile(values, [tail, 1 - tail]) - middle) / -ndtri(tail)
            below, above = max(below, -lower), max(above, upper)
    return float(max(below, min(above, most_above * below)))
