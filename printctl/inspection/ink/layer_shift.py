"""Find the shift at which a layer's lines explain its picture best.

For every shift the ink's profile is fitted anew, by least squares over all pixels: the sums that
this takes are correlations of the picture with maps of distance, found for all shifts at once by
Fourier's transform.

A profile that may have even and odd parts fits at any small shift: to first order a shift *is* an
odd part. So ink is taken to be even (a level, a shade, rims) or odd (slopes lit from one side), by
which of both explains more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import fft

from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.inspection.ink.ink_model import NODES, ODD, InkModel, cover_at
from printctl.inspection.ink.passes import REACH_WIDTHS, Passes
from printctl.inspection.options import SeeingOptions
from printctl.inspection.path_samples import PathSamples
from printctl.inspection.values import FloatImage, Shift

_PROFILE_NODES: Final = 8
"""Nodes of the coarse profile within its reach."""
_INK_NODES: Final = 4
"""Nodes of ink from the middle: profiles that reach half a width beyond a line's edge let lines
that touch fit at any place."""
_USUAL_SHIFT_MM: Final = 0.03
"""Scale of the prior of shifts (Student's t): peaked at the design, with long tails."""
_RIDGE_SHARE: Final = 1e-3
"""Ridge of a profile's fit, relative to its mean power."""
_MAX_ODD_REST_RATIO: Final = 1.15
"""Rest of odd over even ink up to which odd ink is considered: lines of one direction fit with both
parts at any place."""
_MIN_CROSSING_SHARE: Final = 0.05
"""Least spread of directions, second over first axis, that fixes a layer's shift in both."""
_BESIDE_WIDTHS: Final = (0.7, 1.3)
"""Distances in widths at which other places are compared with the layer's own."""
_MIN_FOUND_LOG_ODDS: Final = 1.0
"""Least log odds of the layer's place over places beside it: in 48 pictures of shadow and mottle
without ink one exceeded it."""
_MIN_REST_SHARE: Final = 1e-3
"""Share of the picture's power that stays unexplained at least."""
_MIN_SCATTER_MM: Final = 1e-3
"""Least scatter of lines' offsets: the pixel grid."""
_U_GRID_PX: Final = 0.15
"""Standard uncertainty of the shift from the pixel grid (laser maps of 37 painted layers: 0.2)."""
_OUTLIER_SPREADS: Final = 3.0
"""Spreads at which a place's weight falls to one half."""
_CORRELATION_WIDTHS: Final = 10.0
"""Length along a line, in widths, over which offsets and changes may be correlated."""


@dataclass(frozen=True)
class CoarseShift:
    """Coarse estimate of a layer's shift.

    Attributes
    ----------
    shift_px : (2,) float64, px
        x and y.
    odd : bool
        Whether its ink shows by slopes that are lit from one side.
    lines_found : bool
        Whether lines explain the picture clearly better there than a width beside: a shadow's edge,
        or mottle, is explained as well by lines anywhere. True for covers, which aren't tested.
    """

    shift_px: FloatArray
    odd: bool
    lines_found: bool


def coarse_shift(
    image: FloatImage,
    lost: BoolArray,
    passes: Passes,
    inner: FloatImage,
    width_px: float,
    most_px: float,
    px_per_mm: float,
    covers: bool,
    by_change: bool,
) -> CoarseShift:
    """Return the most probable shift on the pixel grid.

    Parameters
    ----------
    image : (h, w, c) float32
        Without light, ground and older ink; noise of the ground 1.
    lost : (h, w) bool
    passes : Passes
        At the designed place.
    inner : (h, w, 4) float32
        Weight of each pass, 0 to 1.
    width_px, most_px : float, px
        Of a line; farthest shift.
    px_per_mm : float
    covers : bool
        Whether ink shows by one level over its width, and not by shade or slopes.
    by_change : bool
        Whether that level is how much changed.
    """
    even, odd = _maps(passes, inner)
    cover = cover_at(passes.distance)
    if covers:
        even = [(inner * cover).max(axis=2)]
    far = max(1, math.ceil(most_px), math.ceil(_BESIDE_WIDTHS[1] * width_px))
    shape = tuple(fft.next_fast_len(n + 2 * far, real=True) for n in image.shape[:2])
    image = np.where(lost[:, :, None], np.float32(0.0), image)
    seen = [fft.rfft2(np.ascontiguousarray(one), shape) for one in np.moveaxis(image, 2, 0)]
    square = (image**2).sum(axis=2)
    whole = float(square.sum())
    samples_used = float((inner.max(axis=2) > 0.0).sum()) * image.shape[2]
    alike = _CORRELATION_WIDTHS if by_change else 1.0
    count = 0.5 * samples_used / max(1.0, alike * width_px**2)
    by = np.arange(-far, far + 1)
    sides = _constrained_by_sides(passes, inner, by)
    away = np.hypot(*np.meshgrid(by, by))
    prior = _prior(away, most_px, _USUAL_SHIFT_MM * px_per_mm)
    prior[~sides] = -np.inf
    scores = [_scores(seen, maps, by, shape) for maps in (even, odd)]
    logs = [
        _log_of(_explained(score, maps), whole, count)
        for score, maps in zip(scores, (even, odd), strict=True)
    ]
    if covers:  # a cover's sums can leave out pixels that are lost or at line ends
        ends = (cover * (passes.piece >= 0)).max(axis=2) - even[0]
        shown, power = (fft.rfft2(one, shape) for one in (~lost + np.float32(0.0), square))
        covered = _scores([shown], [even[0] ** 2], by, shape)[0, 0]
        explained = (scores[0][:, 0] ** 2).sum(axis=0) / np.maximum(covered, 1e-9)
        left = whole - _scores([power], [ends], by, shape)[0, 0]
        logs[0] = _log_of(explained, left, count)
    both = _log_of(_explained(np.concatenate(scores, axis=1), even + odd), whole, count) + prior
    here = [log + prior for log in logs]
    top = [np.unravel_index(int(np.argmax(log)), log.shape) for log in here]
    near = float(here[1].max() - here[0].max()) > -count * math.log(_MAX_ODD_REST_RATIO)
    is_odd = not covers and near and bool(both[top[1]] > both[top[0]])
    log, (row, column) = here[is_odd], (int(k) for k in top[is_odd])
    beside = sides & (away > _BESIDE_WIDTHS[0] * width_px) & (away < _BESIDE_WIDTHS[1] * width_px)
    margin = float(logs[is_odd][row, column] - logs[is_odd][beside].max(initial=-np.inf))
    lines_found = covers or margin > _MIN_FOUND_LOG_ODDS
    place = np.array([_parabola_top(log[row], column), _parabola_top(log[:, column], row)]) - far
    return CoarseShift(place, is_odd, lines_found)


def finer_shift(
    shift: Shift,
    offset: FloatArray,
    samples: PathSamples,
    use: BoolArray,
    options: SeeingOptions,
) -> Shift:
    """Return a shift corrected by the offsets of lines, by robust least squares.

    Parameters
    ----------
    shift : Shift
    offset : (n,) float64, widths
        Offset of each place to the left of its shifted position.
    samples : PathSamples
    use : (n,) bool
    options : SeeingOptions
    """
    if not use.any():
        return shift
    off, normal = offset[use] * samples.width[use], samples.normal[use]
    independent = np.minimum(samples.step[use] / samples.width[use], 1.0)
    step, cov = np.zeros(2), np.full((2, 2), np.inf)
    for _ in range(3):
        rest = off - normal @ step
        spread = max(1.4826 * float(np.median(np.abs(rest))), _MIN_SCATTER_MM)
        weight = independent / (1.0 + (rest / (_OUTLIER_SPREADS * spread)) ** 2) / spread**2
        power = (normal * weight[:, None]).T @ normal + np.eye(2) / options.shift_mm**2
        cov = np.linalg.inv(power)
        step = cov @ ((normal * weight[:, None]).T @ off)
    pull = normal * (weight * (off - normal @ step))[:, None]
    cov = cov * _design_effect(pull, cov, samples.run[use], samples.along[use] / samples.width[use])
    return Shift(float(shift.dx_mm + step[0]), float(shift.dy_mm + step[1]), cov)


def with_systematics(
    shift: Shift, model: InkModel, odd: bool, width_mm: float, pixel_mm: float
) -> Shift:
    """Add the uncertainty by shade and the pixel grid to a shift.

    To first order a move by d of an even profile p is an odd part, d p'. So the odd part that a fit
    finds beside the shift stands for as much that the shift may have taken for a move.

    Parameters
    ----------
    shift : Shift
    model : InkModel
    odd : bool
        Whether ink shows by slopes: then even and odd change places.
    width_mm, pixel_mm : float, mm
    """
    fresh = model.profile[:2]
    even, slopes = fresh[:, :1], fresh[:, list(ODD)]
    main, other = (slopes, even) if odd else (even, slopes)
    slope = np.diff(main, axis=2) * (NODES / REACH_WIDTHS)
    of_width = math.sqrt(float((other**2).sum()) / max(float((slope**2).sum()), 1e-12))
    cov = shift.covariance_mm2 + np.eye(2) * (
        (of_width * width_mm) ** 2 + (_U_GRID_PX * pixel_mm) ** 2
    )
    return replace(shift, covariance_mm2=cov)


def _design_effect(pull: FloatArray, cov: FloatArray, run: IntArray, along: FloatArray) -> float:
    """Return the factor, at least 1, by which correlation along lines raises the variance.

    Sums of what places pull by, (n, 2), over stretches of a line against the covariance that they
    should have (Liang and Zeger 1986, Biometrika 73, 13).
    """
    stretch = np.floor(along / _CORRELATION_WIDTHS).astype(np.int64)
    _, of = np.unique(np.column_stack([run, stretch]), axis=0, return_inverse=True)
    sums = np.stack([np.bincount(of.ravel(), weights=pull[:, k]) for k in range(2)])
    return max(1.0, 0.5 * float(np.trace(cov @ sums @ sums.T)))


def _prior(away: FloatArray, most_px: float, usual_px: float) -> FloatArray:
    """Return the log prior of shifts."""
    return np.where(away > most_px, -np.inf, -1.5 * np.log1p((away / usual_px) ** 2))


def _constrained_by_sides(passes: Passes, inner: FloatImage, by: IntArray) -> BoolArray:
    """Return which shifts (dy, dx) lines' sides constrain: none along parallel lines.

    Along them only gaps would, and those must not move the layer.
    """
    weight = inner * (np.abs(passes.distance) < 0.5)
    spread = np.einsum("yxm,yxmi,yxmj->ij", weight, passes.normal, passes.normal)
    size, axes = np.linalg.eigh(spread)
    x, y = np.meshgrid(by, by)
    if size[0] > _MIN_CROSSING_SHARE * size[1]:
        return np.ones(x.shape, dtype=np.bool_)
    return np.asarray(np.abs(x * axes[0, 0] + y * axes[1, 0]) < 0.75)


def _scores(
    seen: list[FloatArray], maps: list[FloatImage], by: IntArray, shape: tuple[int, ...]
) -> FloatArray:
    """Return the correlation of each channel with each map at each shift, (c, m, dy, dx)."""
    spectra = [np.conj(fft.rfft2(one, shape)) for one in maps]
    window = np.ix_(by, by)
    return np.array([[fft.irfft2(one * each, shape)[window] for each in spectra] for one in seen])


def _explained(scores: FloatArray, maps: list[FloatImage]) -> FloatArray:
    """Return the sum of squares explained by a profile of these maps at each shift, (dy, dx)."""
    flat = np.stack(maps).reshape(len(maps), -1).astype(np.float64)
    power = flat @ flat.T
    power += _RIDGE_SHARE * max(float(np.trace(power)) / len(maps), 1e-9) * np.eye(len(maps))
    solved = np.einsum("ij,cjyx->ciyx", np.linalg.inv(power), scores)
    return np.asarray((scores * solved).sum(axis=(0, 1)))


def _log_of(explained: FloatArray, whole: float | FloatArray, count: float) -> FloatArray:
    """Return the log likelihood for a rest of unknown variance."""
    rest = np.maximum(whole - explained, _MIN_REST_SHARE * whole + 1e-9)
    return np.asarray(-count * np.log(rest))


def _maps(passes: Passes, inner: FloatImage) -> tuple[list[FloatImage], list[FloatImage]]:
    """Return even and odd basis functions of the distance to fresh lines, (h, w) each."""
    at = np.abs(passes.distance) * (_PROFILE_NODES / REACH_WIDTHS)
    sign = np.where(passes.distance < 0, np.float32(-1.0), np.float32(1.0))
    even, odd = [], []
    for j in range(_INK_NODES):
        hat = inner * np.maximum(np.float32(1.0) - np.abs(at - np.float32(j)), np.float32(0.0))
        even.append(hat.sum(axis=2))
        if j:
            odd += [(hat * sign * passes.normal[..., k]).sum(axis=2) for k in range(2)]
    return even, odd


def _parabola_top(values: FloatArray, k: int) -> float:
    """Return the top of a parabola through the highest value and its neighbours."""
    if k == 0 or k == len(values) - 1 or not np.isfinite(values[[k - 1, k + 1]]).all():
        return float(k)
    low, top, high = values[k - 1 : k + 2]
    bend = low - 2.0 * top + high
    return float(k + 0.5 * (low - high) / bend) if bend < -1e-12 else float(k)
