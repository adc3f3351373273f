"""Fit the shading of ridges that are lit from the side, and where the layer lies by it.

A bead's surface is brighter where it slopes to the light and darker where it slopes away, so that
brightness (logarithm, over the bath) at a place is, with d its distance from the nearest line's
middle in widths and a the direction to it from there in the picture,

    m(d, a) = m0(d) + m1(d) cos a + m2(d) sin a,

each a function of d alone: Lambert's law for a small slope, whatever the bead's section. Ends and
turns follow from the nearest line, as the height of beads that run into each other does. A picture
of bright flanks alone fits nearly as well a quarter of a width aside, where it seems symmetric; the
dark flanks, ends and turns tell where the ridges truly lie.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

import cv2
import numpy as np
from scipy.spatial import cKDTree

from registration.layer_images.ink_image import ACROSS
from registration.layer_images.values import (
    BoolArray,
    ExpectedLines,
    FloatArray,
    FloatImage,
    IntArray,
    Shift,
)
from registration.layer_images.ways import Ways, from_stroke_begin
from registration.layer_images.working import Masks, Working, WorkingFrame

_KNOTS: Final = np.array([0.0, 0.12, 0.24, 0.36, 0.48, 0.6, 0.72])
"""Widths from a line's middle; beyond the last lies bath. Blur carries light over the edge."""
_FAR: Final = 1.05
_GRID: Final = 0.11
"""Widths between samples."""
_MOST: Final = 2_000
_FEWEST: Final = 400
_REACH: Final = 0.5
"""Widths, by which the symmetric look may have been off."""
_STEPS: Final = 9
_FINER: Final = 3
_AXIS: Final = 0.05
"""Widths between the points that stand for lines."""
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
_CENTRE: Final = 0.4
"""Weight of the middle one of the points that stand for blur."""
_LEAST_U: Final = 0.05
"""Widths: standard uncertainty of a place by shading at least."""


Nearest = Callable[[FloatArray], tuple[FloatArray, BoolArray]]
"""Vectors to places from the nearest line's middle, mm, and whether any is near."""


@dataclass(frozen=True)
class Axes:
    """Points along the middles of fresh lines.

    Attributes
    ----------
    tree : cKDTree
        Of (m, 2) points, mm.
    stroke : (m,) int64
    along : (m,) float64, mm
        From the stroke's begin.
    step_mm : float, mm
        Between neighbours, at most.
    """

    tree: cKDTree
    stroke: IntArray
    along: FloatArray
    step_mm: float

    @staticmethod
    def of(lines: ExpectedLines) -> Axes:
        """Lay points along all fresh lines, their ends included."""
        step = _AXIS * float(np.median(lines.width_mm[lines.fresh]))
        length = np.linalg.norm(lines.end - lines.start, axis=1)
        begin = from_stroke_begin(lines.stroke, length)
        rows = np.flatnonzero(lines.fresh)
        count = np.maximum(2, np.ceil(length[rows] / step).astype(np.int64) + 1)
        own = np.repeat(rows, count)
        share = np.concatenate([np.linspace(0.0, 1.0, n) for n in count])
        at = lines.start[own] + share[:, None] * (lines.end - lines.start)[own]
        along = begin[own] + share * length[own]
        return Axes(cKDTree(at[:, :2]), lines.stroke[own], along, step)

    def nearest(self, at: FloatArray, within_mm: float) -> tuple[FloatArray, BoolArray]:
        """Vectors to places (k, 2) from the nearest point, mm, and whether it is so near, (k,)."""
        far, row = self.tree.query(at, distance_upper_bound=within_mm)
        near = np.isfinite(far)
        return at - self.tree.data[np.where(near, row, 0)], np.asarray(near)

    def nearest_other(
        self, at: FloatArray, stroke: IntArray, along: FloatArray, apart_mm: float, within_mm: float
    ) -> tuple[FloatArray, BoolArray]:
        """The same from the nearest point that isn't within ``apart_mm`` along its own stroke."""
        count = min(int(2.0 * apart_mm / self.step_mm) + 4, len(self.along))
        far, row = self.tree.query(at, k=count, distance_upper_bound=within_mm)
        near = np.isfinite(far)
        row = np.where(near, row, 0)
        own = self.stroke[row] == stroke[:, None]
        other = near & ~(own & (np.abs(self.along[row] - along[:, None]) < apart_mm))
        first = other.argmax(axis=1)
        found = row[np.arange(len(at)), first]
        return at - self.tree.data[found], other.any(axis=1)


@dataclass(frozen=True)
class RidgeLight:
    """Shading of ridges, and the layer's shift by it.

    Attributes
    ----------
    terms : (3, 7) float64
        m0, m1, m2 at `_KNOTS`.
    level : float
        Of the bath.
    channels : slice
        Those of the picture whose mean it describes.
    to_picture : (2, 2) float64, px/mm
    axes : Axes
    width_mm : float, mm
    blur_mm : float, mm
        Standard deviation of the picture's blur, which smooths creases where beads meet.
    shift : Shift
    """

    terms: FloatArray
    level: float
    channels: slice
    to_picture: FloatArray
    axes: Axes
    width_mm: float
    blur_mm: float
    shift: Shift

    @property
    def slant(self) -> float:
        """Root of the power of the odd part over that of the even one."""
        return _slant(self.terms)

    def shade(self, at: FloatArray, nearest: Nearest) -> FloatArray:
        """Brightness over the bath at places (k, 2), mm, whose nearest lines are looked up."""
        basis = _blurred(at, nearest, self.to_picture, self.width_mm, self.blur_mm)
        return np.asarray(basis @ _flat(self.terms))

    def across(self) -> FloatArray:
        """m0, m1, m2 over `ACROSS`, (3, 61)."""
        sides = np.stack([np.interp(np.abs(ACROSS), _KNOTS, row) for row in self.terms])
        sides[1:] *= np.sign(ACROSS)
        return np.asarray(np.where(np.abs(ACROSS) <= _KNOTS[-1], sides, 0.0))


def _blurred(
    at: FloatArray, nearest: Nearest, to_picture: FloatArray, width_mm: float, blur_mm: float
) -> FloatArray:
    """`_basis` averaged over five points that have a blur's variance, (k, 16)."""
    out = _basis(*nearest(at), to_picture, width_mm)
    if blur_mm <= 0:
        return out
    out *= _CENTRE
    side = blur_mm * np.sqrt(2.0 / (1.0 - _CENTRE))
    for off in side * np.array([(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)]):
        out += 0.25 * (1.0 - _CENTRE) * _basis(*nearest(at + off), to_picture, width_mm)
    return out


def _basis(
    apart: FloatArray, near: BoolArray, to_picture: FloatArray, width_mm: float
) -> FloatArray:
    """Value of each term's knots (all but the last; the odd ones without the first), (k, 16)."""
    d = np.linalg.norm(apart, axis=1) / width_mm
    seen = apart @ to_picture.T
    way = seen / np.maximum(np.linalg.norm(seen, axis=1), 1e-9)[:, None]
    inner = len(_KNOTS) - 1
    hats = np.column_stack([np.interp(d, _KNOTS, one) for one in np.eye(inner, len(_KNOTS))])
    hats[~near | (d > _KNOTS[-1])] = 0.0
    return np.hstack([hats, hats[:, 1:] * way[:, :1], hats[:, 1:] * way[:, 1:]])


def _flat(terms: FloatArray) -> FloatArray:
    return np.concatenate([terms[0, :-1], terms[1, 1:-1], terms[2, 1:-1]])


def _terms(values: FloatArray) -> FloatArray:
    inner = len(_KNOTS) - 1
    out = np.zeros((3, len(_KNOTS)))
    out[0, :-1] = values[:inner]
    out[1:, 1:-1] = values[inner : 3 * inner - 2].reshape(2, inner - 1)
    return out


def _slant(terms: FloatArray) -> float:
    """Root of odd over even power, as of `Template`."""
    odd, even = float((terms[1:] ** 2).sum()), float((terms[0] ** 2).sum())
    return float(np.sqrt(odd / max(even, 1e-12)))


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
        nearest = partial(self.axes.nearest, within_mm=_KNOTS[-1] * self.width_mm)
        at, blur_mm = self.at - shift_mm, blur * self.width_mm
        basis = _blurred(at, nearest, self.to_picture, self.width_mm, blur_mm)
        basis = np.hstack([np.ones((len(basis), 1)), basis])
        power = basis.T @ basis + 1e-3 * np.eye(basis.shape[1])
        both, total = basis.T @ self.values, float(self.values @ self.values)
        best = np.linalg.solve(power, both)
        even = len(_KNOTS)
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
    axes, width = Axes.of(lines), float(np.median(ways.width))
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
    low, high = axes.tree.mins - _FAR * width, axes.tree.maxes + _FAR * width
    x, y = (np.arange(a, b, _GRID * width) for a, b in zip(low, high, strict=True))
    at = np.stack(np.meshgrid(x, y), axis=2).reshape(-1, 2)
    if len(at) > 20 * _MOST:
        at = at[rng.choice(len(at), 20 * _MOST, replace=False)]
    _, near = axes.nearest(at, _FAR * width)
    at = at[near]
    at = at if len(at) <= _MOST else at[rng.choice(len(at), _MOST, replace=False)]
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
    terms = _terms(values[1:])
    if _slant(terms) < _ODD or float(left[rival].min()) < _RIVAL_WORSE * coarse:
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
