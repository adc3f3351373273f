"""Fit the light on ridges that are lit from the side, and where the layer lies by it.

A picture of bright flanks alone fits nearly as well a quarter of a width aside, where it seems
symmetric; the dark flanks, ends and turns tell where the ridges truly lie.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from kernels.arrays import FloatArray
from registration.inspection.pictures.working import Masks, Working, WorkingFrame
from registration.inspection.ridges.ridge_axes import Axes, Stretch, are_near, axes_of
from registration.inspection.ridges.ridge_shading import (
    KNOTS,
    RidgeLight,
    blurred_basis,
    slant_of,
    terms_of,
)
from registration.inspection.values import ExpectedLines, FloatImage, Shift
from registration.inspection.ways import Ways

_FAR: Final = 1.05
_GRID: Final = 0.11
"""Widths between samples."""
_MOST: Final = 2_000
_FEWEST: Final = 400
_REACH: Final = 0.5
"""Widths, by which the symmetric look may have been off."""
_STEPS: Final = 9
_FINER: Final = 3
_MOST_LEFT: Final = 0.5
"""Of the picture's variance around the lines, that the shading may leave."""
_LESS: Final = 0.6
"""Of what a symmetric look leaves."""
_ODD: Final = 1.0
"""Times the symmetric part: so strong is the light from the side at least."""
_RIVAL: Final = 0.3
"""Widths from the best place, from which on another is a rival."""
_RIVAL_WORSE: Final = 1.1
"""Times what the best place leaves, that a rival leaves at least."""
_TOGETHER: Final = 20.0
"""Samples that share a bath's texture."""
_BLURS: Final = (0.04, 0.08, 0.12, 0.16, 0.2)
"""Widths: standard deviations of blur that are tried."""
_LEAST_U: Final = 0.05
"""Widths: standard uncertainty of a place by shading at least."""


@dataclass(frozen=True)
class _Samples:
    """Places around lines, mm, and the picture there."""

    at: FloatArray
    values: FloatArray
    axes: Axes
    to_picture: FloatArray
    width_mm: float

    def left(self, shift_mm: FloatArray, blur: float = 0.0) -> tuple[float, float, FloatArray]:
        """Variance left by the shading and by m0 alone at a shift, and coefficients, (17,)."""
        at, whole = self.at - shift_mm, Stretch.nothing(len(self.at))
        basis = blurred_basis(
            self.axes, at, whole, self.to_picture, self.width_mm, blur * self.width_mm
        )
        basis = np.hstack([np.ones((len(basis), 1)), basis])
        power = basis.T @ basis + 1e-3 * np.eye(basis.shape[1])
        both, total = basis.T @ self.values, float(self.values @ self.values)
        best = np.linalg.solve(power, both)
        even = len(KNOTS)
        alone = np.linalg.solve(power[:even, :even], both[:even])
        count = len(self.values)
        left = (total - float(best @ both)) / count
        return left, (total - float(alone @ both[:even])) / count, np.asarray(best)


def ridge_light(
    work: Working,
    frame: WorkingFrame,
    lines: ExpectedLines,
    ways: Ways,
    masks: Masks,
    flat: FloatImage,
    shift: Shift,
    rng: np.random.Generator,
) -> RidgeLight | None:
    """Return the light on ridges near a shift; None where the picture isn't one of lit ridges.

    Parameters
    ----------
    work, frame, lines, ways, masks
        Of the layer.
    flat : (h, w, c) float32
        Channels without light.
    shift : Shift
        Where the layer seems to lie.
    rng : Generator
    """
    axes, width = axes_of(lines), float(np.median(ways.width))
    middle = ways.point.mean(axis=0)
    step = 0.5 * width * np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    to_picture = (frame.to_pixels(middle + step) - frame.to_pixels(middle - step)).T / width
    begun = np.array([shift.dx_mm, shift.dy_mm])
    at, px = _places(work, frame, axes, masks, begun, width, float(middle[2]), rng)
    if len(at) < _FEWEST:
        return None
    best: RidgeLight | None = None
    least = _MOST_LEFT
    for channels in _halves(work, flat):
        mean = np.ascontiguousarray(flat[:, :, channels].mean(axis=2))
        x, y = px.T.astype(np.float32)
        values = cv2.remap(mean, x[:, None], y[:, None], cv2.INTER_LINEAR)[:, 0].astype(np.float64)
        samples = _Samples(at, values, axes, to_picture, width)
        found = _fitted(samples, begun)
        if found is not None and found[0] < least:
            least, terms, level, blur_mm, moved = found
            best = RidgeLight(terms, level, channels, to_picture, axes, width, blur_mm, moved)
    return best


def _halves(work: Working, flat: FloatImage) -> list[slice]:
    """Channels of the picture itself, and of its change since the one before."""
    count = flat.shape[2] if work.earlier is None else work.earlier.shape[2]
    return [slice(0, count)] + ([] if work.earlier is None else [slice(count, None)])


def _places(
    work: Working,
    frame: WorkingFrame,
    axes: Axes,
    masks: Masks,
    begun: FloatArray,
    width: float,
    z_mm: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Places around the lines, where only fresh ink or bath is; mm, and in the picture."""
    low, high = axes.at.min(axis=0) - _FAR * width, axes.at.max(axis=0) + _FAR * width
    x, y = (np.arange(a, b, _GRID * width) for a, b in zip(low, high, strict=True))
    at = np.stack(np.meshgrid(x, y), axis=2).reshape(-1, 2)
    if len(at) > 20 * _MOST:
        at = at[np.sort(rng.choice(len(at), 20 * _MOST, replace=False))]
    at = at[are_near(axes, at, _FAR * width)]
    at = at if len(at) <= _MOST else at[np.sort(rng.choice(len(at), _MOST, replace=False))]
    at = at + begun
    px = frame.to_pixels(np.column_stack([at, np.full(len(at), z_mm)]))
    finite = np.isfinite(px).all(axis=1)
    at, px = at[finite], px[finite]
    cell = np.rint(px).astype(np.int64)
    inside = ((cell >= 1) & (cell < np.array(work.shape[::-1]) - 1)).all(axis=1)
    at, px, cell = at[inside], px[inside], cell[inside]
    side = 2 * round(0.3 * width * work.px_per_mm) + 1
    other = masks.old | (work.bad | work.hidden).astype(np.uint8)
    other = cv2.dilate(other, np.ones((side, side), np.uint8))
    free = other[cell[:, 1], cell[:, 0]] == 0
    return at[free], px[free]


def _fitted(
    samples: _Samples, begun: FloatArray
) -> tuple[float, FloatArray, float, float, Shift] | None:
    """Share of variance left, terms, level, blur and shift; None where they aren't ridges'."""
    total = float(samples.values.var())
    steps = np.linspace(-_REACH, _REACH, _STEPS) * samples.width_mm
    grid = np.stack(np.meshgrid(steps, steps), axis=2).reshape(-1, 2) + begun
    left, symmetric = np.array([samples.left(one)[:2] for one in grid]).T
    best, coarse = grid[int(left.argmin())], float(left.min())
    rival = np.linalg.norm(grid - best, axis=1) > _RIVAL * samples.width_mm
    if coarse > min(_MOST_LEFT * total, _LESS * float(symmetric.min())):
        return None
    blur = min(_BLURS, key=lambda one: samples.left(best, one)[0])
    half = steps[1] - steps[0]
    for _ in range(_FINER):
        half *= 0.5
        near = best + half * np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
        best = near[int(np.argmin([samples.left(one, blur)[0] for one in near]))]
    least, _, values = samples.left(best, blur)
    terms = terms_of(values[1:])
    if slant_of(terms) < _ODD or float(left[rival].min()) < _RIVAL_WORSE * coarse:
        return None
    covariance = _covariance(samples, best, least, blur)
    shift = Shift(float(best[0]), float(best[1]), covariance)
    return least / total, terms, float(values[0]), blur * samples.width_mm, shift


def _covariance(samples: _Samples, best: FloatArray, least: float, blur: float) -> FloatArray:
    """Covariance of a shift, mm², by how much worse the shading fits beside it."""
    h = 0.1 * samples.width_mm
    x, y = h * np.eye(2)
    beside = {
        (i, j): samples.left(best + i * x + j * y, blur)[0] for i in (-1, 0, 1) for j in (-1, 0, 1)
    }
    bend = np.array([[beside[1, 0] + beside[-1, 0] - 2 * least, 0.0], [0.0, 0.0]])
    bend[1, 1] = beside[0, 1] + beside[0, -1] - 2 * least
    bend[0, 1] = bend[1, 0] = 0.25 * (beside[1, 1] + beside[-1, -1] - beside[1, -1] - beside[-1, 1])
    share, axes = np.linalg.eigh(bend / h**2 * len(samples.values) / (2.0 * _TOGETHER * least))
    reach = _REACH * samples.width_mm
    known = (axes / np.maximum(share, 1.0 / reach**2)) @ axes.T
    return np.asarray(known + (_LEAST_U * samples.width_mm) ** 2 * np.eye(2))
