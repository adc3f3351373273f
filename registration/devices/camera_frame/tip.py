"""Find a needle's tip in a picture: its pixel, diameter, and the end's tilt and roughness.

Two edges of about the right distance show the needle; a model of a rod's end is fitted there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, map_coordinates, spline_filter
from scipy.optimize import OptimizeResult, least_squares
from scipy.signal import find_peaks
from scipy.special import ndtr

from kernels.arrays import BoolArray, FloatArray
from registration.devices.camera_frame.frame import CameraFrame
from registration.devices.camera_frame.marks import check_size
from registration.devices.camera_frame.tip_patch import TipPatch, tip_patch
from registration.errors import PictureError

_LEANS: Final = np.linspace(-0.08, 0.08, 65)
"""Tangents of the needle's angle against where it should point."""
_USUAL_LEAN: Final = 0.05
_PLAY: Final = 0.04
"""Of the width, by which a needle's diameter and its look in a picture differ usually."""
_U_WIDE: Final = 0.007
"""Of the width, by which it differs from its profile's in the fit of light across."""
_ASIDE_STARTS: Final = (0.0, 0.15, -0.15, 0.3, -0.3)
"""Of the width, from which that fit begins."""
_STRETCHES: Final = 8
_HAT_PX: Final = 0.8
"""Of the brightness across; wider ones shift the needle to fit its glare."""
_FAULT_ACROSS: Final = 0.05
"""Of the contrast, by which the mean light across may be off anywhere."""
_SMOOTH: Final = 0.3
"""Second differences of the brightness across, of the contrast, that are usual."""
_FAINT, _LEAST_CLEAR, _ENOUGH = 3.0, 5.0, 15.0
"""Of an edge's gradient over the median of all: below it is none, at least one edge has it, and
beyond it is no better."""
_OTHER_NEEDLE: Final = 13.0
"""Most that a width of another needle costs, in clearness."""
_STRANGE: Final = 20.0
"""Clearness that a column is worth which isn't the ground by more than its deviation."""
_OUTSIDE: Final = 0.6
"""Weight of edges as clear just outside the needle on one side alone."""
_FLOOR_ASIDE_PX: Final = 0.05
_FLOOR_UP_PX: Final = 0.1
"""No tip is known better: light on round steel shifts edges, and an end's rim isn't quite sharp."""
_ABOVE: Final = 3.0
_BELOW: Final = 1.2
_INNER: Final = 0.42
"""What is fitted above and below the end, and taken to either side of the axis, of the width."""
_ROWS: Final = 26
"""Samples of a width at most."""
_HAT_PX: Final = 0.8
"""Of the brightness across; wider hats shift the needle to fit its glare."""
_SMOOTH: Final = 0.3
"""Second differences of the brightness across, of the contrast, that are usual."""
_USUAL_BLUR_PX: Final = 0.9
_U_BLUR: Final = 0.5
"""Of its logarithm."""
_U_TILT: Final = 0.05
"""Of the end, of the width."""
_U_LEAN: Final = 0.03
_U_WIDE: Final = 0.007
"""Of the width, by which it differs from the profile's."""
_FAULTS: Final = (0.12, 0.04, 0.01, 0.01, 0.01)
"""Of the contrast, one fit after the other: no edge is blurred quite as the model has it, and far
from the end all but it would count as noise."""
_STARTS: Final = ((0.0, 0.0), (0.4, 0.0), (-0.4, 0.0), (0.0, 0.15), (0.0, -0.15))
"""Of the width, up and aside, from which the fit begins."""
_HUBER: Final = 2.0
_BLOCK: Final = 4
"""Pixels each way within which deviations are alike."""
_LEAST_CONTRAST: Final = 3.0
"""Of the needle, over what is left around its end."""
_SHORT: Final = 1.5
"""Widths of needle and of ground that must be seen above and below its end."""
_LEAST_STEP: Final = 0.35
"""By which rows of needle deviate more than rows of ground."""


@dataclass(frozen=True, eq=False)
class SeenTip:
    """A tip in one picture.

    Attributes
    ----------
    pixel : (2,) float64
        Of the middle of the needle's end.
    covariance_px2 : (2, 2) float64
    width_mm, u_width_mm : float, mm
        Outer diameter above the end.
    slope : float
        Of the end against straight across (tangent of the angle seen).
    rough : float
        RMS of the end about a flat one's ellipse, of the width.
    lean : float
        Tangent of the needle's angle seen against upright.
    """

    pixel: FloatArray
    covariance_px2: FloatArray
    width_mm: float
    u_width_mm: float
    slope: float
    rough: float
    lean: float


def find_tip(
    image: NDArray[Any],
    frame: CameraFrame,
    tip_mm: FloatArray,
    outer_mm: float,
    *,
    reach_mm: float = 2.0,
    length_mm: float = 12.0,
    ground: NDArray[Any] | None = None,
    source: str = "the picture",
) -> SeenTip:
    """Find the tip of a needle that points down.

    Parameters
    ----------
    image : (h, w) or (h, w, 3)
    frame : CameraFrame
    tip_mm : (3,) float64, mm
        Where the tip should be, printer's frame.
    outer_mm : float, mm
        The needle's outer diameter, by its profile.
    reach_mm : float, mm
        How far off the tip may be.
    length_mm : float, mm
        Of the needle below its hub.
    ground : (h, w) or (h, w, 3), optional
        The same scene without the needle, or with it elsewhere.
    source : str
        Named in messages.

    Raises
    ------
    PictureError
        When it isn't found; says why.
    """
    check_size(image, frame.lens, source)
    if ground is not None:
        check_size(ground, frame.lens, f"the ground of {source}")
    patch = tip_patch(image, frame, np.asarray(tip_mm), outer_mm, reach_mm, ground, length_mm)
    far = reach_mm * patch.px_per_mm
    axis = _needle_axis(patch, far)
    rod = _Rod(patch, axis, _rough_end(patch, axis, far))
    return _seen_tip(patch, rod, rod.fitted())


# --- the needle's axis, by its two edges


class _Axis(NamedTuple):
    """A needle's axis in a patch: place at row 0, px, and lean, px aside for each px up."""

    place: float
    lean: float


def _gradient(patch: TipPatch, rows: BoolArray) -> FloatArray:
    seen = patch.grey if patch.ground is None else patch.grey - patch.ground
    part = np.nan_to_num(seen[rows], nan=float(np.nanmean(seen)))
    return np.asarray(gaussian_filter1d(part, max(0.7, 0.06 * patch.wide_px), axis=1, order=1))


def _upright(gradient: FloatArray, heights: FloatArray, lean: float) -> FloatArray:
    """Rows moved so that what leans stands upright."""
    columns = np.arange(gradient.shape[1]) + lean * heights[:, None]
    rows = np.broadcast_to(np.arange(len(heights))[:, None], columns.shape)
    return np.asarray(map_coordinates(gradient, [rows, columns], order=1, mode="nearest"))


def _needle_axis(patch: TipPatch, lowest: float) -> _Axis:
    """Find the needle in the rows from a height on, where it must be whatever the tip's place.

    Raises
    ------
    PictureError
        When no two edges of about the right distance stand out.
    """
    rows = (patch.above >= lowest) & (np.isfinite(patch.grey).mean(axis=1) > 0.9)
    if rows.sum() < 2 * patch.wide_px:
        raise PictureError(
            "too little of the needle is in the picture above its tip; move it towards the middle"
        )
    gradient, heights = _gradient(patch, rows), patch.above[rows]
    # Rims and threads of glare are parallel: upright, their gradients add up to most.
    means = [_upright(gradient, heights, lean).mean(axis=0) for lean in _LEANS]
    energy = np.array([float((one**2).sum()) for one in means])
    worth = energy * np.exp(-((_LEANS / _USUAL_LEAN) ** 2) / 2)
    best = int(worth.argmax())
    wide = patch.wide_px * (1 + patch.taper * float(heights.mean()))
    edges, clear = _pair(np.abs(means[best]), _strange(patch, rows, float(_LEANS[best])), wide)
    if clear < _LEAST_CLEAR:
        raise PictureError(
            f"the needle isn't found: no two edges {patch.wide_px:.0f} pixels apart stand out "
            f"({clear:.1f} of the ground's deviation, {_LEAST_CLEAR:g} wanted). Is it in view, in "
            "focus, of this diameter (--needle)? A plain ground behind it helps, or several "
            "pictures with the needle at places 5 mm apart"
        )
    middle = float(edges.mean() + patch.beside[0])
    return _Axis(middle, float(_LEANS[best]))


def _strange(patch: TipPatch, rows: BoolArray, lean: float) -> FloatArray:
    """How far each upright column isn't the ground, 0 to 4.4; 0 where the ground isn't known."""
    if patch.ground is None:
        return np.zeros(patch.grey.shape[1])
    off = np.nan_to_num(patch.grey[rows] - patch.ground[rows])
    noise = max(1.4826 * float(np.median(np.abs(off - np.median(off)))), 0.004)
    odd = np.log1p(np.minimum((off / noise) ** 2, 81.0))
    return np.asarray(_upright(odd, patch.above[rows], lean).mean(axis=0))


def _pair(size: FloatArray, strange: FloatArray, wide: float) -> tuple[FloatArray, float]:
    """Columns of two edges, and the clearness of the clearer one.

    Clear ones of about the right distance, with nothing as clear beside one of them, strange inside
    and ground outside. A rim that is as bright as the ground shows no edge: then the other one and
    the width tell.
    """
    total = np.concatenate([[0.0], np.cumsum(strange)])

    def mean(low: float, high: float) -> float:
        first, last = (int(np.clip(round(one), 0, len(strange))) for one in (low, high))
        return float(total[last] - total[first]) / max(last - first, 1)

    noise = 1.4826 * float(np.median(size)) + 1e-9
    at, _ = find_peaks(size, height=_FAINT * noise)
    value = np.minimum(size[at] / noise, _ENOUGH)
    best, most, clear = np.zeros(2), -np.inf, 0.0
    for k, left in enumerate(at):
        pairs = [(float(left), float(left) + wide, 0.0), (float(left) - wide, float(left), 0.0)]
        pairs += [(float(left), float(at[n]), value[n]) for n in range(k + 1, len(at))]
        for low, high, other in pairs:
            ratio = (high - low) / wide
            if not 0.7 < ratio < 1.35:
                continue
            near = 0.08 * wide + 1.5
            outside = [
                value[(at > low - 0.7 * wide) & (at < low - near)].sum(),
                value[(at < high + 0.7 * wide) & (at > high + near)].sum(),
            ]
            score = value[k] + other - min(((ratio - 1) / _PLAY) ** 2 / 2, _OTHER_NEEDLE)
            score -= _OUTSIDE * abs(outside[0] - outside[1])
            beyond = mean(low - 0.3 * wide, low - 1) + mean(high + 1, high + 0.3 * wide)
            score += _STRANGE * (mean(low, high) - beyond / 2)
            if score > most:
                best, most, clear = np.array([low, high]), score, max(value[k], other)
    return best, clear


# --- the needle's end along its axis


def _sampled(
    piece: FloatArray, patch: TipPatch, axis: _Axis, heights: FloatArray, beside: FloatArray
) -> FloatArray:
    """Light at heights (k,) and distances from the axis (m,), (k, m); NaN beyond the picture."""
    rows = np.broadcast_to((heights - patch.above[0])[:, None], (len(heights), len(beside)))
    columns = axis.place + axis.lean * heights[:, None] + beside - patch.beside[0]
    return np.asarray(map_coordinates(piece, [rows, columns], order=1, cval=np.nan))


def _rough_end(patch: TipPatch, axis: _Axis, far: float) -> float:
    """Height from which on the strip along the axis isn't the ground; to half a width.

    Each row's mean square deviation from the ground is high on the needle and low below it: the
    step between is laid where it leaves the least sum of squares.

    Raises
    ------
    PictureError
        When needle and ground are alike, or no clear end is there.
    """
    heights, short = patch.above[1:-1], _SHORT * patch.wide_px
    inner = np.linspace(-_INNER, _INNER, 17) * patch.wide_px
    side = np.linspace(0.75, 1.45, 9) * patch.wide_px
    outer = np.concatenate([-side[::-1], side])
    seen, beside = (_sampled(patch.grey, patch, axis, heights, x) for x in (inner, outer))
    known = np.isfinite(seen).all(axis=1) & (np.isfinite(beside).sum(axis=1) > 4)
    heights, seen, beside = heights[known], seen[known], beside[known]
    if not known.any():
        raise PictureError("too little of the needle is in the picture around its tip")
    if patch.ground is None:
        level = np.nanmedian(beside, axis=1, keepdims=True)
        seen, beside = seen - level, beside - level
    else:
        seen = seen - _sampled(patch.ground, patch, axis, heights, inner)
        beside = beside - _sampled(patch.ground, patch, axis, heights, outer)
    noise = max(1.4826 * float(np.nanmedian(np.abs(beside - np.nanmedian(beside)))), 0.004)
    rows = np.log1p(np.nan_to_num(np.minimum((seen / noise) ** 2, 81.0))).mean(axis=1)
    best, least, step = np.nan, np.inf, 0.0
    for at in heights[(heights >= -far - short / 3) & (heights <= far + short / 3)]:
        # Long stretches of needle change; what lies near the end tells it.
        low = rows[(heights < at) & (heights > at - 3 * short)]
        high = rows[(heights >= at) & (heights < at + 3 * short)]
        if min(len(low), len(high)) < short / 3:
            continue
        left = float(low.var() * len(low) + high.var() * len(high)) / (len(low) + len(high))
        rise = float(high.mean() - low.mean())
        if rise > 0 and left - rise**2 / 4 < least:
            best, least, step = float(at), left - rise**2 / 4, rise
    if step < _LEAST_STEP:
        raise PictureError(
            "the needle's end isn't clear: what lies above and below is alike; put a plain ground "
            "of another brightness behind the tip, or give pictures with the needle at other places"
        )
    if not -far < best < far:
        raise PictureError(
            "the needle's end isn't within reach of where it should be; is the needle longer "
            "or bent, or its place (--tip-at) wrong? Raise --reach-mm"
        )
    return best


class _Rod:
    """Model of a rod's end before the ground, and its deviations from a patch.

    Light is a product of the brightness B(x) across and of a step along, both blurred by a Gauss
    function of deviation b: I(u, h) = ∫ B(x) g((u - x) / b) Φ((h - e(x)) / b) dx, with the end
    e(x) = end + tilt 2 x / w - bow √(1 - (2 x / w)²), the lower half of the ellipse that a flat
    end shows. B is a sum of hats with few bends, and changes along the needle; the ground, or its
    difference from the known one, is a few smooth shapes. Their levels are solved for; fitted are
    end, tilt, place aside, lean, logarithm of b, and w, which is the profile's but for a percent:
    left free it comes out wrong, since a rim may look like the ground.
    """

    def __init__(self, patch: TipPatch, axis: _Axis, end: float) -> None:
        self.patch, self.lean, wide = patch, axis.lean, patch.wide_px
        pitch = max(1.0, wide / _ROWS)
        top = min(end + _ABOVE * wide + 4, float(patch.above[-3]))
        self.heights = np.arange(end - _BELOW * wide - 4, top, pitch)
        self.beside = np.arange(-1.4 * wide - 4, 1.4 * wide + 4, pitch)
        level = float(np.nanmedian(patch.grey))
        each = [patch.grey] if patch.ground is None else [patch.grey, patch.ground]
        self.unknown = np.isnan(np.sum(each, axis=0)).astype(np.float64)
        self.splines = [spline_filter(np.nan_to_num(one, nan=level)) for one in each]
        self.share = (np.arange(4 * int(wide) + 8) + 0.5) / (4 * int(wide) + 8) * 2 - 1
        self.count = int(np.clip(round(wide / _HAT_PX), 7, 60))
        self.hats = np.vstack([_hats(self.share, self.count), _hats(self.share, 3)])
        x = np.broadcast_to(self.beside / wide, (len(self.heights), len(self.beside)))
        y = np.broadcast_to(((self.heights - self.heights.mean()) / wide)[:, None], x.shape)
        shapes = [np.ones_like(x), x, y]
        if patch.ground is None:
            shapes += [x * x, x * y, y * y, np.tanh(4 * x)]
        self.behind = np.array(shapes)
        self.start = np.array([end, 0.0, axis.place, axis.lean, np.log(_USUAL_BLUR_PX), 0.0])
        seen, ground, known = self.samples(self.start)
        off, aside = seen - ground, np.abs(self.beside)
        out = off[:, aside > 0.9 * wide][known[:, aside > 0.9 * wide]]
        rod = off[self.heights > end][:, aside < 0.5 * wide]
        usual = float(np.median(out)) if len(out) else 0.0
        self.noise = max(1.4826 * float(np.median(np.abs(out - usual))), 1e-3) if len(out) else 0.01
        self.contrast = max(float(np.percentile(np.abs(rod - usual), 80)), 0.02)
        self.weight: FloatArray = np.ones(seen.shape)
        self.size = 1.0

    def samples(self, state: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Light of picture and ground about an axis (k, m), and where both are known."""
        patch, above = self.patch, self.heights[:, None]
        wider = 1 + patch.taper * (above - state[0])  # farther up it spreads with the needle
        columns = state[2] + state[3] * above + self.beside * wider - patch.beside[0]
        at = [np.broadcast_to(above - patch.above[0], columns.shape), columns]
        seen, *ground = (
            map_coordinates(one, at, order=3, prefilter=False, mode="nearest")
            for one in self.splines
        )
        known = map_coordinates(self.unknown, at, order=1, cval=1.0) < 0.01
        return seen, ground[0] if ground else np.zeros_like(seen), np.asarray(known)

    def left(self, state: FloatArray) -> FloatArray:
        """Weighted deviations of the light (k m), of the levels' bends, and of what is usual."""
        end, tilt, _, lean, blur, more = state
        b, wide = np.exp(blur), self.patch.wide_px * (1 + more)
        edge = end + tilt * self.share - self.patch.end_px * np.sqrt(1 - self.share**2)
        step = ndtr((self.heights[:, None] - edge) / b)
        off = (self.beside[:, None] - self.share * wide / 2) / b
        across = np.exp(-(off**2) / 2) * (wide / len(self.share) / (b * np.sqrt(2 * np.pi)))
        free = 1 - step @ across.T
        shapes = [(step * hat) @ across.T for hat in self.hats]
        along = (self.heights[:, None] - end) / wide
        shapes[self.count :] = [along * one for one in shapes[self.count :]]
        terms = np.array([*shapes, *(free * self.behind)]).reshape(-1, free.size)
        seen, ground, known = self.samples(state)
        weight = (self.weight * known).ravel() / self.size
        wanted, terms = (seen - free * ground).ravel() * weight, terms * weight
        bends = np.zeros((self.count - 2, len(terms)))
        bends[:, : self.count] = np.diff(np.eye(self.count), 2, axis=0) / _SMOOTH / self.contrast
        normal = terms @ terms.T + bends.T @ bends
        normal += np.diag(1e-9 * np.diag(normal) + 1e-12)  # of shapes that aren't in the picture
        levels = np.linalg.solve(normal, terms @ wanted)
        u_tilt = np.hypot(_U_TILT * wide, tilt / 2)  # a worn end's is larger
        usual = [tilt / u_tilt, (lean - self.lean) / _U_LEAN,
                 (blur - np.log(_USUAL_BLUR_PX)) / _U_BLUR, more / _U_WIDE]  # fmt: skip
        return np.concatenate([wanted - levels @ terms, bends @ levels, usual])

    def slopes(self, state: FloatArray) -> FloatArray:
        """Slopes of `left` by all that is fitted, (n, 6)."""
        steps = np.diag([0.02, 0.02, 0.02, 0.01 / self.patch.wide_px, 0.02, 0.002])
        now = self.left(state)
        return np.stack([(self.left(state + one) - now) / one.sum() for one in steps], axis=1)

    def fitted(self) -> OptimizeResult:
        """Least squares from several places, in steps of ever less fault of the model."""
        wide, found = self.patch.wide_px, list[OptimizeResult]()
        far = np.array([wide, wide, wide, 0.1, 1.5, 0.15])
        starts = [self.start + wide * np.array([up, 0, aside, 0, 0, 0]) for up, aside in _STARTS]
        for fault in _FAULTS:
            self.size = float(np.hypot(self.noise, fault * self.contrast))
            found = [
                least_squares(
                    self.left, one, self.slopes, bounds=(one - far, one + far), x_scale=0.1 * far,
                    max_nfev=25, xtol=1e-5, ftol=1e-6,
                )
                for one in starts
            ]  # fmt: skip
            found.sort(key=lambda one: float(one.cost))
            starts = [found[0].x]
            odd = np.abs(self.deviations(found[0])) / np.maximum(self.weight, 1e-9)
            self.weight = np.minimum(1.0, np.sqrt(_HUBER / np.maximum(odd, 1e-9)))
        return found[0]

    def deviations(self, found: OptimizeResult) -> FloatArray:
        """Weighted deviations of a fit, (k, m)."""
        return np.asarray(found.fun[: self.weight.size].reshape(self.weight.shape))


def _hats(share: FloatArray, count: int) -> FloatArray:
    """Hats over -1 to 1 whose sum is 1, (count, n)."""
    knots = np.linspace(-1, 1, count)
    return np.maximum(0.0, 1 - np.abs(share - knots[:, None]) / (knots[1] - knots[0]))


def _seen_tip(patch: TipPatch, rod: _Rod, found: OptimizeResult) -> SeenTip:
    """The tip with its uncertainty.

    Raises
    ------
    PictureError
        When nothing there stands out as a needle's end.
    """
    left, wide = rod.deviations(found), patch.wide_px * (1 + float(found.x[5]))
    slopes = found.jac[: left.size].reshape(*left.shape, 6)
    outline = np.abs(slopes[..., [0, 2]]).max(axis=-1)
    around = left[outline > 0.3 * outline.max()]
    clear = rod.contrast / (rod.size * float(np.sqrt((around**2).mean())) + 1e-6)
    if not clear > _LEAST_CONTRAST:
        raise PictureError(
            f"the needle's end isn't clear: its contrast is {clear:.1f} of what is left around its "
            f"outline ({_LEAST_CONTRAST:g} wanted); put a plain ground of another brightness "
            "behind the tip, or give pictures with the needle at other places"
        )
    rows, columns = (side // _BLOCK for side in left.shape)
    blocks = left[: rows * _BLOCK, : columns * _BLOCK].reshape(rows, _BLOCK, columns, _BLOCK)
    alike = max(1.0, float(((blocks.sum(axis=(1, 3)) / _BLOCK) ** 2).mean()))
    covariance = np.linalg.inv(found.jac.T @ found.jac) * alike
    end, tilt, place, lean = found.x[:4]
    # Aside at the end is place + lean · end.
    by = np.array([[1.0, 0, 0, 0, 0, 0], [lean, 0, 1.0, end, 0, 0]])
    spread = by @ covariance @ by.T + np.diag([_FLOOR_UP_PX**2, _FLOOR_ASIDE_PX**2])
    turn = np.column_stack([patch.up, patch.aside])
    up = np.where(np.abs(rod.beside) < _INNER * wide, slopes[..., 0], 0.0)
    sure = (up**2).sum(axis=0)
    own = sure > 0.1 * sure.max()
    off = (up * left).sum(axis=0)[own] / sure[own]
    return SeenTip(
        patch.pixel(end, place + lean * end), turn @ spread @ turn.T, wide / patch.px_per_mm,
        float(np.sqrt(covariance[5, 5])) * patch.wide_px / patch.px_per_mm,
        2 * tilt / wide + lean, float(np.sqrt((off**2).mean())) / wide, lean,
    )  # fmt: skip
