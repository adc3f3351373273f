"""Find a needle's tip in a picture: its pixel, diameter, and the end's tilt and roughness.

Two edges of about the right distance show the needle. Its axis is a straight line through the
places at which a rod of its width, blurred, best explains the light across it. Along it, each
column of pixels is the ground below the end and the rod above it, with a blurred step between: the
end's height, tilt and blur are fitted by least squares, the columns' brightness is solved for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, map_coordinates
from scipy.optimize import OptimizeResult, least_squares
from scipy.signal import find_peaks
from scipy.special import ndtr
from scipy.stats import theilslopes

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
_U_WIDTH: Final = 0.01
"""The same of a width, of itself."""
_ABOVE: Final = 3.0
_BELOW: Final = 1.2
_INNER: Final = 0.42
"""What is fitted around the end and to either side of the axis, of the width."""
_USUAL_BLUR_PX: Final = 0.9
_U_BLUR: Final = 0.5
"""Of its logarithm."""
_U_TILT: Final = 0.1
"""Of the end, of the width."""
_FAULT: Final = 0.02
"""Of the contrast, by which the model may be wrong anywhere."""
_HUBER: Final = 2.0
_STARTS: Final = (0.0, 0.4, -0.4)
"""Of the width, up, from which the fit begins."""
_ALIKE: Final = 9.0
"""Sum of squares by which another place must be worse to be none."""
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
    far, wide = reach_mm * patch.px_per_mm, patch.wide_px
    axis = _needle_axis(patch, far)
    rough = _rough_end(patch, axis, far)
    end = _fitted_end(patch, axis, rough)
    axis = _refined(patch, axis, end.place + 0.3 * wide, end.place + 4 * wide)
    end = _fitted_end(patch, axis, end.place)
    turn = np.column_stack([patch.up, patch.aside])
    spread = np.diag([end.u**2 + _FLOOR_UP_PX**2, axis.u**2 + _FLOOR_ASIDE_PX**2])
    return SeenTip(
        patch.pixel(end.place, float(axis.middle(np.array(end.place)))), turn @ spread @ turn.T,
        axis.wide / patch.px_per_mm, axis.u_wide / patch.px_per_mm,
        end.slope + axis.lean, end.rough, axis.lean,
    )  # fmt: skip


# --- the needle's axis, by its two edges


class _Axis(NamedTuple):
    """A needle's axis in a patch: place at row 0, lean (px aside for each px up), width; px."""

    place: float
    lean: float
    u: float
    wide: float
    u_wide: float

    def middle(self, above: FloatArray) -> FloatArray:
        """Of the needle at heights."""
        return np.asarray(self.place + self.lean * above)


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
    return _Axis(middle, float(_LEANS[best]), 1.0, patch.wide_px, patch.wide_px)


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


def _refined(patch: TipPatch, axis: _Axis, low: float, high: float) -> _Axis:
    """Middle and width by the light across, in stretches of rows between two heights."""
    heights = patch.above[(patch.above >= low) & (patch.above <= high)]
    wide = patch.wide_px * (1 + patch.taper * float(heights.mean()))
    whole = _Across(patch, axis, heights)
    starts = [whole.fitted(aside * wide) for aside in _ASIDE_STARTS]
    first = min(starts, key=lambda one: float(one.cost)).x[0]
    points = []
    for stretch in np.array_split(heights, _STRETCHES):
        found = _Across(patch, axis, stretch).fitted(first).x
        points.append((stretch.mean(), found[0], (1 + found[2]) * patch.wide_px))
    above, off, width = np.array(points).T
    slope, place, *_ = theilslopes(off, above)
    scatter = 1.4826 * float(np.median(np.abs(off - place - slope * above)))
    u_width = float(np.hypot(1.4826 * np.median(np.abs(width - np.median(width))), _U_WIDTH * wide))
    return _Axis(
        axis.place + place, axis.lean + slope, 2 * scatter / np.sqrt(_STRETCHES),
        float(np.median(width)), u_width,
    )  # fmt: skip


class _Across:
    """Mean light across a needle over some rows, and what a model of the rod leaves of it.

    Light is the rod's brightness B(x) blurred by a Gauss function of deviation b, over the ground
    where the rod isn't. B is a sum of hats with few bends; the rod is as wide as its profile says,
    but for a percent: left free it comes out wrong, since a rim may look like the ground.
    """

    def __init__(self, patch: TipPatch, axis: _Axis, heights: FloatArray) -> None:
        self.wide = patch.wide_px * (1 + patch.taper * float(heights.mean()))
        self.beside = np.arange(-1.4 * self.wide - 4, 1.4 * self.wide + 4)
        self.seen, self.known = self._mean(patch.grey, patch, axis, heights)
        self.ground, more = np.zeros(len(self.seen)), []
        if patch.ground is not None:
            self.ground, also = self._mean(patch.ground, patch, axis, heights)
            self.known = self.known & also
        else:
            more = [(self.beside / self.wide) ** 2, np.tanh(4 * self.beside / self.wide)]
        self.behind = np.stack([np.ones(len(self.seen)), self.beside / self.wide, *more])
        off = (self.seen - self.ground)[self.known]
        self.contrast = max(float(np.percentile(np.abs(off - np.median(off)), 90)), 0.02)
        count = int(np.clip(round(self.wide / _HAT_PX), 7, 60))
        share = (np.arange(4 * int(self.wide) + 8) + 0.5) / (4 * int(self.wide) + 8) * 2 - 1
        knots = np.linspace(-1, 1, count)
        self.share = share
        self.hats = np.maximum(0, 1 - np.abs(share - knots[:, None]) / (knots[1] - knots[0]))
        self.bends = np.zeros((count - 2, count + len(self.behind)))
        self.bends[:, :count] = np.diff(np.eye(count), 2, axis=0) * (_FAULT_ACROSS / _SMOOTH)

    def _mean(
        self, piece: FloatArray, patch: TipPatch, axis: _Axis, heights: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        light = _sampled(piece, patch, axis, heights, self.beside)
        known = np.isfinite(light).all(axis=0)
        return np.where(known, np.nan_to_num(light).mean(axis=0), 0.0), np.asarray(known)

    def left(self, state: FloatArray) -> FloatArray:
        """Deviations by place aside, logarithm of the blur and width; brightness solved for."""
        aside, blur, wide = state[0], np.exp(state[1]), self.wide * (1 + state[2])
        off = (self.beside[:, None] - aside - self.share * wide / 2) / blur
        spread = np.exp(-(off**2) / 2) * (wide / len(self.share) / (blur * np.sqrt(2 * np.pi)))
        free = 1 - spread.sum(axis=1)
        terms = np.column_stack([spread @ self.hats.T, (free * self.behind).T])
        wanted = (self.seen - free * self.ground) * self.known
        whole = np.vstack([terms * self.known[:, None], self.bends])
        aim = np.concatenate([wanted, np.zeros(len(self.bends))])
        levels = np.linalg.lstsq(whole, aim, rcond=1e-9)[0]
        fit = (aim - whole @ levels) / (_FAULT_ACROSS * self.contrast)
        usual = [(state[1] - np.log(_USUAL_BLUR_PX)) / _U_BLUR, state[2] / _U_WIDE]
        return np.concatenate([fit, usual])

    def fitted(self, aside: float) -> OptimizeResult:
        """Least squares from a place aside."""
        far = 0.3 * self.wide
        low, high = (aside - far, np.log(0.3), -0.15), (aside + far, np.log(6.0), 0.15)
        start = np.array([aside, np.log(_USUAL_BLUR_PX), 0.0])
        return least_squares(self.left, start, bounds=(low, high), loss="huber", f_scale=_HUBER)


# --- the needle's end along its axis


class _End(NamedTuple):
    """Height of an end's middle with its uncertainty, px; slope and roughness, of the width."""

    place: float
    u: float
    slope: float
    rough: float


def _sampled(
    piece: FloatArray, patch: TipPatch, axis: _Axis, heights: FloatArray, beside: FloatArray
) -> FloatArray:
    """Light at heights (k,) and distances from the axis (m,), (k, m); NaN beyond the picture."""
    rows = np.broadcast_to((heights - patch.above[0])[:, None], (len(heights), len(beside)))
    columns = axis.middle(heights)[:, None] + beside - patch.beside[0]
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


class _Step:
    """Columns of pixels about an end, and what a blurred step leaves of them."""

    def __init__(self, patch: TipPatch, axis: _Axis, end: float) -> None:
        wide = patch.wide_px
        self.bow = patch.end_px
        self.share = np.linspace(-_INNER, _INNER, max(7, round(2 * _INNER * wide))) * 2
        top = min(end + _ABOVE * wide, float(patch.above[-3]))
        self.heights = np.arange(end - _BELOW * wide, top, 1.0)
        beside = self.share / 2 * wide
        seen = _sampled(patch.grey, patch, axis, self.heights, beside)
        ground = np.zeros_like(seen)
        if patch.ground is not None:
            ground = _sampled(patch.ground, patch, axis, self.heights, beside)
        self.known = np.isfinite(seen) & np.isfinite(ground)
        self.seen, self.ground = np.nan_to_num(seen), np.nan_to_num(ground)
        below = self.heights < end - 0.5 * wide
        off = (seen - ground)[below]
        usual = np.nanmedian(off) if below.any() else 0.0
        self.noise = max(1.4826 * float(np.nanmedian(np.abs(off - usual))), 2e-3)
        high = (seen - ground)[self.heights > end + 0.5 * wide]
        self.contrast = max(float(np.nanpercentile(np.abs(high - usual), 80)), 0.02)
        self.size = float(np.hypot(self.noise, _FAULT * self.contrast))
        self.weight: FloatArray = self.known / self.size

    def left(self, state: FloatArray) -> FloatArray:
        """Deviations (k, m) by end, tilt and logarithm of the blur, levels solved for."""
        end, tilt, blur = state[0], state[1], float(np.exp(state[2]))
        edge = end + tilt * self.share - self.bow * np.sqrt(1 - self.share**2)
        rod = ndtr((self.heights[:, None] - edge) / blur)
        along = (self.heights[:, None] - end) / len(self.heights)
        terms = np.stack([1 - rod, rod, along * rod], axis=-1) * self.weight[..., None]
        wanted = (self.seen - (1 - rod) * self.ground) * self.weight
        normal = np.einsum("kmi,kmj->mij", terms, terms) + 1e-6 * np.eye(3)
        pull = np.einsum("kmi,km->mi", terms, wanted)
        levels = np.linalg.solve(normal, pull[..., None])[..., 0]
        return np.asarray(wanted - np.einsum("kmi,mi->km", terms, levels))

    def fitted(self, start: FloatArray, wide: float) -> OptimizeResult:
        """Least squares near a state, with Huber's weights."""
        usual = np.array([_U_TILT * wide, _U_BLUR])
        place = np.array([0.0, np.log(_USUAL_BLUR_PX)])

        def off(state: FloatArray) -> FloatArray:
            return np.concatenate([self.left(state).ravel(), (state[1:] - place) / usual])

        low = [start[0] - wide, -wide, np.log(0.3)]
        high = [start[0] + wide, wide, np.log(6.0)]
        self.weight = self.known / self.size
        for _ in range(3):
            found = least_squares(off, start, bounds=(low, high), x_scale=(1.0, 1.0, 0.3))
            start = found.x
            odd = np.abs(self.left(start)) / np.maximum(self.weight * self.size, 1e-9)
            share = np.sqrt(np.minimum(1.0, _HUBER / np.maximum(odd, 1e-9)))
            self.weight = self.known * share / self.size
        return found


def _fitted_end(patch: TipPatch, axis: _Axis, near: float) -> _End:
    """Fit the end near a height; places that fit as well are in its uncertainty.

    Raises
    ------
    PictureError
        When nothing there stands out as a needle's end.
    """
    wide = patch.wide_px
    step = _Step(patch, axis, near)
    starts = [np.array([near + up * wide, 0.0, np.log(_USUAL_BLUR_PX)]) for up in _STARTS]
    found = sorted((step.fitted(one, wide) for one in starts), key=lambda one: float(one.cost))
    best = found[0]
    left = best.fun[:-2].reshape(step.seen.shape)
    slope = best.jac[:-2, 0].reshape(left.shape)
    outline = np.abs(slope).max(initial=1e-9)
    around = np.abs(slope) > 0.3 * outline
    clear = step.contrast / (step.size * float(np.sqrt((left[around] ** 2).mean())) + 1e-6)
    if not clear > _LEAST_CONTRAST:
        raise PictureError(
            f"the needle's end isn't clear: its contrast is {clear:.1f} of what is left around its "
            f"outline ({_LEAST_CONTRAST:g} wanted); put a plain ground of another brightness "
            "behind the tip, or give pictures with the needle at other places"
        )
    rows, columns = (side // _BLOCK for side in left.shape)
    blocks = left[: rows * _BLOCK, : columns * _BLOCK].reshape(rows, _BLOCK, columns, _BLOCK)
    alike = max(1.0, float(((blocks.sum(axis=(1, 3)) / _BLOCK) ** 2).mean()))
    covariance = np.linalg.inv(best.jac.T @ best.jac) * alike
    spread = covariance[0, 0]
    for other in found[1:]:
        if 2 * (other.cost - best.cost) < _ALIKE * alike:
            spread += (other.x[0] - best.x[0]) ** 2 / 2
    sure = (slope**2).sum(axis=0)
    off = (slope * left).sum(axis=0)[sure > 0.1 * sure.max()] / sure[sure > 0.1 * sure.max()]
    rough = float(np.sqrt((off**2).mean())) / wide
    spread += (rough * wide) ** 2 / 4  # an end that isn't as flat as the model's: some four parts
    return _End(float(best.x[0]), float(np.sqrt(spread)), 2 * float(best.x[1]) / wide, rough)
