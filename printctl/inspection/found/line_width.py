"""Estimate the widths of lines that are free on both sides.

The layer's usual width is estimated from the profile, for each candidate shape: ink that covers
what lies below, an ellipse's or parabola's height (or way of light through it), a bead on an
upright foot, or a shell that shows by its rims; each blurred. Of heights the foot may lie below the
map's part of the layer. The spread over all shapes that fit is the uncertainty, mostly no better
than a tenth. Relative to the usual width each station's own is found by Gauss and Newton's method:
its share of ink, offset and width, without any prior.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from scipy.special import ndtr

from kernels.arrays import BoolArray, FloatArray
from printctl.inspection.ink.ink_model import NODES, InkModel
from printctl.inspection.ink.passes import REACH_WIDTHS
from printctl.inspection.ink.shares import ACROSS_WIDTHS, group_by_lost_samples
from printctl.inspection.values import LineShapes

_WIDTH_RATIOS: Final = np.arange(0.5, 1.6, 0.01)
"""Candidate ratios of measured to expected width."""
_BLUR_WIDTHS: Final = np.array([0.03, 0.05, 0.07, 0.1, 0.13, 0.17, 0.22, 0.3])
"""Candidate standard deviations of blur, in widths; the last is milky ink's, which scatters
light."""
_BEAD_SHAPES: Final = (
    (("cover", 1.0),),
    (("ellipse", 1.0),),
    (("parabola", 1.0),),
    *((("cover", 1.0 - part), ("ellipse", part)) for part in (0.25, 0.5, 0.75)),
)
_SHELL_SHAPES: Final = tuple(
    ((inside, 1.0 if much else 0.0), (f"shell{t}", much or 1.0))
    for inside in ("cover", "ellipse")
    for t in (0.1, 0.2)
    for much in (-4.0, -2.0, -1.0, 0.0, 1.0, 2.0, 4.0)
)
"""Shapes as terms and their amounts. A shell may be brighter or darker than what it encloses; its
thickness is in half widths."""
_CUT_SHAPES: Final = tuple(
    ((f"{round_}{cut}", 1.0),) for round_ in ("ellipse", "parabola") for cut in (0.0, 0.2, 0.4, 0.6)
)
"""Shapes of heights: rounds, and the share of them that lies below the map's part of the layer."""
_INDEPENDENT_NODES: Final = 4
"""Independent nodes of a profile, whose neighbours are correlated. Of 291 looks at flows of 70 to
130 % (benchmarks/checkers/scene_painter.py) 97 % of the widths lay within two standard
uncertainties, by 5 nodes 95 %, by 3 99 %."""
U_WIDTH_BEFORE: Final = 0.25
"""Standard deviation of the log of measured over expected width before a look."""
_MIN_MISFIT: Final = 1e-4
"""Least squared misfit of a shape, because shapes are sampled at nodes."""
_ITERATIONS: Final = 4
_MIN_SHAPE_U: Final = 0.02
"""Least relative standard uncertainty of a shape's width: nodes are a tenth of a width apart."""
_MAX_STRIP_U: Final = 0.3
"""Largest relative standard uncertainty of a strip's width for it to be used."""
_INDEPENDENT_SHARE: Final = 0.4
"""Share of a station's places that count as independent."""


@dataclass(frozen=True)
class UsualWidth:
    """Usual width of all lines of a look, by its profile.

    Attributes
    ----------
    ratio, u : float
        Width over the expected one, and its relative standard uncertainty.
    u_change : float
        That of its change since the last look; infinite for none.
    shapes : LineShapes or None
        With this look.
    """

    ratio: float = 1.0
    u: float = math.inf
    u_change: float = math.inf
    shapes: LineShapes | None = None


@dataclass(frozen=True)
class StationWidths:
    """Widths at stations.

    Attributes
    ----------
    width_mm, random_mm : (m,) float64, mm
        Width, and the random part of its uncertainty; NaN where unknown.
    offset_mm : (m,) float64, mm
        Of the middle, to the left.
    common : float
        Relative standard uncertainty of all widths together.
    seam_share : (m,) float64
        Share of ink of lines that touch; NaN elsewhere.
    usual : UsualWidth
        Of all lines.
    """

    width_mm: FloatArray
    random_mm: FloatArray
    offset_mm: FloatArray
    common: float
    seam_share: FloatArray
    usual: UsualWidth

    @property
    def u_mm(self) -> FloatArray:
        """Standard uncertainty of each, (m,), mm."""
        return np.hypot(self.random_mm, self.common * self.width_mm)


def estimate_width_ratio(
    model: InkModel, is_heights: bool, before: LineShapes | None = None
) -> UsualWidth:
    """Estimate the ratio of measured to expected width from a look's profile.

    Mean and standard deviation over all shapes, blurs and widths, weighted by their likelihood
    (noise of unknown variance, `_INDEPENDENT_NODES` nodes). Shape and blur are shared with looks
    ``before`` in the same light, so that a change of the width only stretches the profile.
    """
    even = model.profile[0, 0]  # (nodes, c)
    weight = np.linalg.svd(even, full_matrices=False)[2][0]
    profile = (even @ weight)[:NODES]
    profile = profile / max(float(np.linalg.norm(profile)), 1e-12)
    shapes = _CUT_SHAPES if is_heights else _BEAD_SHAPES + _SHELL_SHAPES
    rest = np.concatenate([_misfits(terms, profile) for terms in shapes]) + _MIN_MISFIT
    misfits, looks = rest.min(axis=1), 1
    usual = np.exp(-0.5 * (np.log(_WIDTH_RATIOS) / U_WIDTH_BEFORE) ** 2)
    likely = (rest / misfits[:, None]) ** (-_INDEPENDENT_NODES / 2) * usual
    each = likely / likely.sum(axis=1, keepdims=True)
    log_ratio = each @ np.log(_WIDTH_RATIOS)
    known = before is not None and len(before.misfits) == len(misfits)
    if before is not None and known:
        looks += before.looks
        misfits = misfits + (before.misfits - misfits) * (before.looks / looks)
    weight = (misfits / misfits.min()) ** (-_INDEPENDENT_NODES / 2)
    of_ratio = weight @ likely
    of_ratio /= of_ratio.sum()
    ratio = float(of_ratio @ _WIDTH_RATIOS)
    spread = math.sqrt(float(of_ratio @ (_WIDTH_RATIOS - ratio) ** 2))
    u_change = math.inf
    if before is not None and known:
        weight = weight * likely.sum(axis=1)
        change, own = log_ratio - before.log_ratio, each @ np.log(_WIDTH_RATIOS) ** 2 - log_ratio**2
        off = change - np.average(change, weights=weight)
        u_change = math.sqrt(float(np.average(off**2 + own, weights=weight)))
    return UsualWidth(
        ratio,
        math.hypot(spread / ratio, _MIN_SHAPE_U),
        u_change,
        LineShapes(misfits, log_ratio, looks),
    )


def _misfits(terms: tuple[tuple[str, float], ...], profile: FloatArray) -> FloatArray:
    """Return the squared misfit to a profile of norm 1 at each blur and ratio, (blurs, ratios)."""
    return np.asarray(1.0 - (_shapes(terms) @ profile) ** 2)


@cache
def _shapes(terms: tuple[tuple[str, float], ...]) -> FloatArray:
    """Return a shape at the nodes, of norm 1, (blurs, ratios, nodes)."""
    at = np.asarray(np.arange(NODES) * (REACH_WIDTHS / NODES), dtype=np.float64)
    half = 0.5 * _WIDTH_RATIOS[:, None]
    much = np.array([each for _, each in terms])
    each_blur = [
        np.tensordot(much, [_shape(one, at, half, float(blur)) for one, _ in terms], axes=1)
        for blur in _BLUR_WIDTHS
    ]
    shape = np.array(each_blur)
    return np.asarray(shape / np.linalg.norm(shape, axis=2, keepdims=True))


def _shape(term: str, at: FloatArray, half: FloatArray, blur: float) -> FloatArray:
    """Return a blurred profile of half widths (r, 1) at distances (n,), widths."""
    if term == "cover":
        return np.asarray(ndtr((half - at) / blur) - ndtr((-half - at) / blur))
    if term.startswith("shell"):
        inner = 1.0 - float(term.removeprefix("shell"))
        inside = _shape("ellipse", at, np.asarray(inner * half, dtype=np.float64), blur)
        return np.asarray(_shape("ellipse", at, half, blur) - inner * inside)
    # A round's blur, by Gauss and Hermite's five nodes.
    nodes = np.array([-2.0202, -0.9586, 0.0, 0.9586, 2.0202]) * math.sqrt(2.0)
    weights = np.array([0.01995, 0.39362, 0.94531, 0.39362, 0.01995]) / 1.77245
    height = np.clip(1.0 - ((at[:, None] + blur * nodes) / half[:, :, None]) ** 2, 0.0, None)
    name = "parabola" if term.startswith("parabola") else "ellipse"
    height = height if name == "parabola" else np.sqrt(height)
    cut = float(term.removeprefix(name) or 0.0)
    return np.asarray((np.clip(height - cut, 0.0, None) * weights).sum(axis=2))


def station_widths(
    strips: FloatArray,
    own: FloatArray,
    lost: BoolArray,
    places: FloatArray,
    expected_mm: FloatArray,
    has_width: BoolArray,
    noise: FloatArray,
    usual: UsualWidth,
    seam_share: FloatArray,
) -> StationWidths:
    """Measure the widths of stations where ``has_width``.

    Parameters
    ----------
    strips, own : (m, u, c) float64
        Mean strips, and full ink's profile there.
    lost : (m, u) bool
        Samples that weren't seen.
    places : (m,) float64
        Places in each.
    expected_mm : (m,) float64, mm
    has_width : (m,) bool
    noise : (u c, u c) float64
        Inverse covariance of one strip.
    usual : UsualWidth
    seam_share : (m,) float64
    """
    count = len(expected_mm)
    nothing = np.full(count, np.nan)
    missing = np.repeat(lost[:, :, None], strips.shape[2], axis=2)
    rows = np.flatnonzero(has_width & np.isfinite(strips).all(axis=(1, 2)))
    if not len(rows):
        return StationWidths(nothing, nothing, nothing, usual.u, seam_share, usual)
    rest = np.where(missing, np.nan, strips - own)[rows]
    shown = np.isfinite(rest).any(axis=0)
    left = np.zeros(rest.shape[1:])
    left[shown] = np.nanmedian(rest[:, shown], axis=0)
    own = own + left  # what all stations leave alike is the profile's own error: it is smooth
    wide, off, spread = np.ones(len(rows)), np.zeros(len(rows)), np.full(len(rows), np.inf)
    for some, inverse, _ in group_by_lost_samples(noise, lost[rows]):
        wide[some], off[some], spread[some] = _fit_widths(
            strips[rows[some]], own[rows[some]], inverse
        )
    number = np.maximum(_INDEPENDENT_SHARE * places[rows], 1.0)
    ratio = usual.ratio
    width, random, offset = nothing.copy(), nothing.copy(), nothing.copy()
    random[rows] = spread / np.sqrt(number) * ratio * expected_mm[rows]
    sure = spread < _MAX_STRIP_U
    width[rows[sure]] = ratio * wide[sure] * expected_mm[rows[sure]]
    offset[rows[sure]] = off[sure] * expected_mm[rows[sure]]
    return StationWidths(width, random, offset, usual.u, seam_share, usual)


def _fit_widths(
    strips: FloatArray, own: FloatArray, inverse: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return widths and offsets relative to the usual width, and the widths' uncertainty."""
    count = len(strips)
    share, off, wide = np.ones(count), np.zeros(count), np.ones(count)
    cov = np.zeros((count, 3, 3))
    for _ in range(_ITERATIONS):
        at = (ACROSS_WIDTHS[None, :] - off[:, None]) / wide[:, None]
        shape, slope = _resample(own, at)
        by_place = -share[:, None, None] * slope / wide[:, None, None]
        basis = np.stack([shape, by_place, by_place * at[:, :, None]], axis=1)
        basis = basis.reshape(count, 3, -1)
        rest = (strips - share[:, None, None] * shape).reshape(count, -1)
        weighted = basis @ inverse
        power = np.einsum("nij,nkj->nik", weighted, basis) + 1e-6 * np.eye(3)
        cov = np.linalg.inv(power)
        step = np.einsum("nij,nj->ni", cov, np.einsum("nij,nj->ni", weighted, rest))
        share = np.clip(share + step[:, 0], 0.1, 3.0)
        off = np.clip(off + step[:, 1], -0.3, 0.3)
        wide = np.clip(wide + step[:, 2], 0.4, 1.8)
    return wide, off, np.sqrt(cov[:, 2, 2])


def _resample(own: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Resample profiles (m, u, c) and their slopes at other distances (m, u)."""
    step = ACROSS_WIDTHS[1] - ACROSS_WIDTHS[0]
    place = np.clip((at - ACROSS_WIDTHS[0]) / step, 0.0, len(ACROSS_WIDTHS) - 1 - 1e-9)
    low = place.astype(np.int64)
    part = (place - low)[:, :, None]
    row = np.arange(len(own))[:, None]
    slope = np.gradient(own, step, axis=1)
    values, slopes = (one[row, low] * (1 - part) + one[row, low + 1] * part for one in (own, slope))
    return values, slopes
