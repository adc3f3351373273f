"""Fit a rod model to a needle's end in a patch by robust Gauss-Newton steps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, spline_filter

from kernels.arrays import FloatArray
from registration.devices.camera_frame.rod_model import Lattice, RodEnd, RodModel, hat_count
from registration.devices.camera_frame.tip_patch import NeedleAxis, TipPatch
from registration.errors import PictureError

_ABOVE: Final = 3.0
_BELOW: Final = 1.2
_BESIDE: Final = 1.4
"""What is fitted around the end, of the width."""
_ROOM_PX: Final = 4.0
_ROWS: Final = 26
"""Samples of a width at most."""
_LEAST_NOISE: Final = 1e-3
_LEAST_CONTRAST: Final = 0.02


class Samples(NamedTuple):
    """Light of the picture and of the ground (k, m), 0 to 1, and where both are known."""

    seen: FloatArray
    ground: FloatArray | None
    known: NDArray[np.bool_]


class TipLight:
    """The light of a patch, to be sampled at any place.

    Attributes
    ----------
    wide : float, px
        Of the needle at its end, by its profile.
    noise : float
        Deviation of the ground beside the needle.
    contrast : float
        Of the needle to its ground.
    """

    def __init__(self, patch: TipPatch, axis: NeedleAxis) -> None:
        self._patch = patch
        self.wide = patch.wide_px
        self._known = np.isfinite(patch.grey)
        if patch.ground is not None:
            self._known &= np.isfinite(patch.ground)
        level = float(np.nanmedian(patch.grey))
        self._grey = spline_filter(np.nan_to_num(patch.grey, nan=level))
        self._ground = (
            None if patch.ground is None else spline_filter(np.nan_to_num(patch.ground, nan=level))
        )
        self.noise, self.contrast = self._levels(axis)

    def _levels(self, axis: NeedleAxis) -> tuple[float, float]:
        """Noise and contrast."""
        patch = self._patch
        aside = np.abs(patch.beside - axis.beside - axis.lean * patch.above[:, None])
        off = patch.grey - (np.nanmedian(patch.grey) if patch.ground is None else patch.ground)
        out = off[self._known & (aside > 0.9 * self.wide) & (aside < 2 * self.wide)]
        rod = off[self._known & (aside < 0.5 * self.wide) & (patch.above[:, None] > 0)]
        if min(len(out), len(rod)) < 20:
            return 0.01, 0.1
        middle = float(np.median(out))
        noise = 1.4826 * float(np.median(np.abs(out - middle)))
        contrast = float(np.percentile(np.abs(rod - middle), 80))
        return max(noise, _LEAST_NOISE), max(contrast, _LEAST_CONTRAST)

    def lattice(self, end: float) -> Lattice:
        """Where the model of an end at a height is compared."""
        step = max(1.0, self.wide / _ROWS)
        low = end - _BELOW * self.wide - _ROOM_PX
        high = min(end + _ABOVE * self.wide + _ROOM_PX, float(self._patch.above[-3]))
        far = _BESIDE * self.wide + _ROOM_PX
        bow = self._patch.end_px / self._patch.wide_px
        return Lattice(np.arange(low, high, step), np.arange(-far, far + step / 2, step), bow)

    def around(self, lattice: Lattice, rod: RodEnd, beside: float, lean: float) -> Samples:
        """Light at the lattice's places about an axis; farther up they spread with the needle."""
        heights = lattice.heights[:, None]
        wider = 1 + self._patch.taper * (heights - rod.end)
        columns = beside + lean * heights + lattice.beside * wider - self._patch.beside[0]
        rows = np.broadcast_to(heights - self._patch.above[0], columns.shape)
        known = map_coordinates(self._known.astype(np.float64), [rows, columns], order=1, cval=0.0)
        ground = None if self._ground is None else _splined(self._ground, rows, columns)
        return Samples(_splined(self._grey, rows, columns), ground, known > 0.99)


def _splined(coefficients: FloatArray, rows: FloatArray, columns: FloatArray) -> FloatArray:
    return np.asarray(
        map_coordinates(coefficients, [rows, columns], order=3, prefilter=False, mode="nearest")
    )


USUAL_BLUR_PX: Final = 0.9
_U_WIDE: Final = 0.007
"""Of the width. Left free it comes out 3 % too wide, since rims may look like the ground, and
the end, whose bow goes with it, too high."""
_U_TILT: Final = 0.05
"""Of the end, of the width."""
_U_BLUR: Final = 0.5
"""Of its logarithm."""
_U_LEAN: Final = 0.03
_HELD: Final = 0.01
"""Of these deviations, while the end is far."""
_FREE: Final = 1e6
_SMOOTH: Final = 0.3
"""Second differences of the brightness across, of the contrast, that are usual."""
_HUBER: Final = 2.0
_REWEIGHTS: Final = 3
_STEP_PX: Final = 0.02
_SHAPES_MORE: Final = 3
"""Shapes of the rod besides its hats."""


@dataclass(frozen=True)
class TipState:
    """A needle's end, and its axis in the patch: place at row 0 and lean."""

    rod: RodEnd
    beside: float
    lean: float


@dataclass(frozen=True, eq=False)
class Solved:
    """Best levels at a state, and the way on from there.

    Attributes
    ----------
    state : TipState
    step : (6,) float64
        Of end, tilt, place aside, lean, logarithm of the blur, width.
    cost : float
        Sum of squares, of standard uncertainties.
    normal : (n, n) float64
        Products of the slopes of all unknowns, the six first.
    left, weight : (k, m) float64
        Deviations, and the inverse of their squares that are usual.
    slopes : (6, k, m) float64
    lattice : Lattice
    """

    state: TipState
    step: FloatArray
    cost: float
    normal: FloatArray
    left: FloatArray
    weight: FloatArray
    slopes: FloatArray
    lattice: Lattice


def solve_step(
    light: TipLight, state: TipState, usual_lean: float, fault: float, held: bool
) -> Solved:
    """Solve for the levels at a state, then for a step of all unknowns (Gauss and Newton).

    Parameters
    ----------
    light : TipLight
    state : TipState
    usual_lean : float
    fault : float
        Of the contrast, by which the model may be wrong anywhere.
    held : bool
        Whether tilt and width stay.
    """
    lattice = light.lattice(state.rod.end)
    samples = light.around(lattice, state.rod, state.beside, state.lean)
    size = float(np.hypot(light.noise, fault * light.contrast))
    count = hat_count(light.wide)
    model = RodModel(state.rod, lattice, count)
    cover, behind = model.cover(), _behind(lattice, samples.ground, light.wide)
    terms = np.concatenate([model.shapes(), (1 - cover) * behind])
    fixed = 0.0 if samples.ground is None else (1 - cover) * samples.ground
    bends = _bends(count, len(terms)) / (_SMOOTH * light.contrast)
    levels, left, weight = _levels(terms, samples, samples.seen - fixed, size, bends)
    slopes = _slopes(state.rod, lattice, count, levels, _back(levels, behind, samples))
    sure, now = _usual(state, light.wide, usual_lean, held)
    many = len(sure)
    by = np.concatenate([slopes, terms]).reshape(many + len(terms), -1)
    normal = (by * weight.ravel()) @ by.T
    pull = by @ (weight * left).ravel()
    normal[:many, :many] += np.diag(sure**-2.0)
    pull[:many] -= now / sure**2
    normal[many:, many:] += bends.T @ bends
    pull[many:] -= bends.T @ (bends @ levels)
    normal += _ridge(normal)
    cost = (weight * left**2).sum() + ((now / sure) ** 2).sum() + ((bends @ levels) ** 2).sum()
    step = np.linalg.solve(normal, pull)[:many]
    return Solved(state, step, float(cost), normal, left, weight, slopes, lattice)


def _usual(
    state: TipState, wide: float, usual_lean: float, held: bool
) -> tuple[FloatArray, FloatArray]:
    """Usual deviations of the six unknowns, and those at a state."""
    share = _HELD if held else 1.0
    tilt = float(np.hypot(_U_TILT * wide, state.rod.tilt))  # a worn end's is larger
    sure = [_FREE, share * tilt, _FREE, _U_LEAN, _U_BLUR, share * _U_WIDE * wide]
    blur = float(np.log(state.rod.blur / USUAL_BLUR_PX))
    now = [0.0, state.rod.tilt, 0.0, state.lean - usual_lean, blur, state.rod.wide - wide]
    return np.array(sure), np.array(now)


def _levels(
    terms: FloatArray, samples: Samples, wanted: FloatArray, size: float, bends: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Levels of all shapes by Huber's weights, what is left (k, m), and the weights (k, m)."""
    by = terms.reshape(len(terms), -1)
    weight = samples.known / size**2
    for _ in range(_REWEIGHTS):
        normal = (by * weight.ravel()) @ by.T + bends.T @ bends
        levels = np.linalg.solve(normal + _ridge(normal), by @ (weight * wanted).ravel())
        left = wanted - np.tensordot(levels, terms, 1)
        off = np.abs(left) / size
        weight = samples.known * np.minimum(1.0, _HUBER / np.maximum(off, 1e-9)) / size**2
    return np.asarray(levels), left, weight


def _ridge(normal: FloatArray) -> FloatArray:
    """What keeps shapes that aren't in the picture from making it singular."""
    return np.diag(1e-9 * np.diag(normal) + 1e-12)


def _bends(count: int, terms: int) -> FloatArray:
    """Second differences of the brightness across, over all levels."""
    bends = np.zeros((count - 2, terms))
    for n in range(count - 2):
        bends[n, n : n + 3] = [1.0, -2.0, 1.0]
    return bends


def _behind(lattice: Lattice, ground: FloatArray | None, wide: float) -> FloatArray:
    """Shapes of which the ground, or its difference from the known one, is made, (n, k, m)."""
    x = np.broadcast_to(lattice.beside / wide, (len(lattice.heights), len(lattice.beside)))
    y = np.broadcast_to(((lattice.heights - lattice.heights.mean()) / wide)[:, None], x.shape)
    plain = [np.ones_like(x), x, y]
    if ground is None:
        plain += [x * x, x * y, y * y, np.tanh(4 * x)]
    return np.array(plain)


def _back(levels: FloatArray, behind: FloatArray, samples: Samples) -> FloatArray:
    """The ground as fitted, (k, m)."""
    own = np.tensordot(levels[-len(behind) :], behind, 1)
    return np.asarray(own if samples.ground is None else own + samples.ground)


def _slopes(
    rod: RodEnd, lattice: Lattice, count: int, levels: FloatArray, back: FloatArray
) -> FloatArray:
    """How the model changes with end, tilt, place aside, lean, log blur, width; (6, k, m)."""

    def picture(one: RodEnd, aside: float = 0.0) -> FloatArray:
        model = RodModel(one, lattice, count, aside)
        return model.light(levels[: count + _SHAPES_MORE]) + (1 - model.cover()) * back

    d = _STEP_PX
    plain = picture(rod)
    up = (picture(replace(rod, end=rod.end + d)) - plain) / d
    tilt = (picture(replace(rod, tilt=rod.tilt + d)) - plain) / d
    aside = (picture(rod, d) - picture(rod, -d)) / (2 * d)
    blur = (picture(replace(rod, blur=rod.blur * (1 + d))) - plain) / d
    wide = (picture(replace(rod, wide=rod.wide + d)) - plain) / d
    return np.array([up, tilt, aside, aside * lattice.heights[:, None], blur, wide])


_ROUNDS: Final = 15
_STILL_PX: Final = 2e-3
_FAULTS: Final = (0.12, 0.04, 0.01)
"""Of the contrast, one fit after the other: no edge is blurred quite as the model has it, and far
from the end all but it would count as noise."""

_STARTS: Final = ((0.0, 0.0), (0.0, 0.4), (0.0, -0.4), (0.15, 0.0), (-0.15, 0.0))
"""Of the width, aside and up, from which the fit begins."""
_WORSE: Final = 2.0
"""Of the least sum of squares, beyond which a place isn't followed up."""
_SAME_PX: Final = 0.2
_ALIKE: Final = 9.0
"""Sum of squares by which another place must be worse to be none."""
_BLURS_PX: Final = (0.3, 6.0)
_MAX_STEP_WIDTHS: Final = 0.2
_FAR_LEAN: Final = 0.03
_FAR_BLUR: Final = 0.5
"""Longest step, of the width; of lean; of the blur's logarithm."""
_WIDTHS: Final = (0.85, 1.15)
_LEAST_CLEAR: Final = 3.0
_BLOCK: Final = 4
"""Pixels each way within which deviations are alike."""


@dataclass(frozen=True, eq=False)
class FittedTip:
    """A needle's end in a patch.

    Attributes
    ----------
    above, beside : float, px
        Of the end's middle in the patch.
    covariance_px2 : (2, 2) float64
        Of above and beside.
    wide_px, u_wide_px : float
        Width at the end.
    tilt, u_tilt : float
        Rise of the end over the whole width, of the width.
    lean : float
        Pixels aside for each pixel up.
    rough : float
        RMS of the end about the flat one, of the width.
    clear : float
        Contrast over the deviations left at the rod's outline.
    """

    above: float
    beside: float
    covariance_px2: FloatArray
    wide_px: float
    u_wide_px: float
    tilt: float
    u_tilt: float
    lean: float
    rough: float
    clear: float


def fit_end(patch: TipPatch, axis: NeedleAxis, end: float) -> FittedTip:
    """Fit the end near a height and an axis that are known to a part of the width.

    Raises
    ------
    PictureError
        When nothing there stands out as a needle's end.
    """
    light = TipLight(patch, axis)
    states = []
    for aside, up in _STARTS:
        rod = RodEnd(end + up * light.wide, 0.0, USUAL_BLUR_PX, light.wide)
        states.append(TipState(rod, axis.beside + aside * light.wide, axis.lean))
    for fault in _FAULTS:
        found = sorted(
            (_settled(light, state, axis.lean, fault) for state in states), key=lambda one: one.cost
        )
        found = _apart([one for one in found if one.cost < _WORSE * found[0].cost])
        states = [one.state for one in found]
    return _answer(light, found[0], found[1:])


def _settled(light: TipLight, state: TipState, usual_lean: float, fault: float) -> Solved:
    """The least sum of squares near a state."""
    held = fault == _FAULTS[0]
    for _ in range(_ROUNDS):
        solved = solve_step(light, state, usual_lean, fault, held)
        if np.abs(solved.step[:3]).max() < max(_STILL_PX, fault):
            break
        state = _moved(solved, light.wide)
    return solved


def _moved(solved: Solved, wide: float) -> TipState:
    """The state a step farther, no farther than a part of the width."""
    state, far = solved.state, _MAX_STEP_WIDTHS * wide
    end, tilt, aside, lean, blur, wider = solved.step
    rod = RodEnd(
        state.rod.end + float(np.clip(end, -far, far)),
        float(np.clip(state.rod.tilt + np.clip(tilt, -far, far), -wide, wide)),
        float(np.clip(state.rod.blur * np.exp(np.clip(blur, -_FAR_BLUR, _FAR_BLUR)), *_BLURS_PX)),
        float(np.clip(state.rod.wide + wider, _WIDTHS[0] * wide, _WIDTHS[1] * wide)),
    )
    return TipState(
        rod,
        state.beside + float(np.clip(aside, -far, far)),
        state.lean + float(np.clip(lean, -_FAR_LEAN, _FAR_LEAN)),
    )


def _apart(found: list[Solved]) -> list[Solved]:
    """Those that aren't the same as an earlier one."""
    kept: list[Solved] = []
    for one in found:
        if all(np.abs(_way(old.state, one.state)).max() > _SAME_PX for old in kept):
            kept.append(one)
    return kept


def _way(one: TipState, other: TipState) -> FloatArray:
    """From one end to another: up, aside; px."""
    aside = other.beside + other.lean * other.rod.end - one.beside - one.lean * one.rod.end
    return np.array([other.rod.end - one.rod.end, aside])


def _answer(light: TipLight, best: Solved, others: list[Solved]) -> FittedTip:
    """The end with its uncertainty; places that fit as well are in it."""
    clear = _clear(light, best)
    if not clear > _LEAST_CLEAR:
        raise PictureError(
            f"the needle's end isn't clear: its contrast is {clear:.1f} of what is left around its "
            f"outline ({_LEAST_CLEAR:g} wanted); put a plain ground of another brightness behind "
            "the tip, or give pictures with the needle at other places"
        )
    rod, alike = best.state.rod, _alike(best)
    covariance = np.linalg.inv(best.normal)[:6, :6] * alike
    # Aside at the end is beside + lean · end.
    by = np.array([[1.0, 0, 0, 0, 0, 0], [best.state.lean, 0, 1.0, rod.end, 0, 0]])
    place = by @ covariance @ by.T
    for other in others:
        if other.cost - best.cost < _ALIKE * alike:
            apart = _way(best.state, other.state)
            place = place + np.outer(apart, apart) / 2
    return FittedTip(
        rod.end,
        best.state.beside + best.state.lean * rod.end,
        place,
        rod.wide,
        float(np.sqrt(covariance[5, 5])),
        2 * rod.tilt / rod.wide,
        2 * float(np.sqrt(covariance[1, 1])) / rod.wide,
        best.state.lean,
        _rough(best, light.wide) / light.wide,
        clear,
    )


def _alike(solved: Solved) -> float:
    """By how much blocks of pixels deviate more than if each pixel did for itself."""
    off = np.sqrt(solved.weight) * solved.left
    rows, columns = (side // _BLOCK * _BLOCK for side in off.shape)
    blocks = off[:rows, :columns].reshape(rows // _BLOCK, _BLOCK, columns // _BLOCK, _BLOCK)
    sums = blocks.sum(axis=(1, 3)) / _BLOCK
    return max(1.0, float((sums**2).mean()))


def _clear(light: TipLight, solved: Solved) -> float:
    """Contrast over the deviations left at the outline."""
    outline = np.abs(solved.slopes[[0, 2]]).max(axis=0)
    near = outline > 0.3 * outline.max()
    return float(light.contrast / (np.sqrt((solved.left[near] ** 2).mean()) + 1e-6))


def _rough(solved: Solved, wide: float) -> float:
    """RMS by which the end deviates in columns from the flat one, px."""
    up = solved.slopes[0]
    sure = (up**2).sum(axis=0)
    within = (np.abs(solved.lattice.beside) < 0.42 * wide) & (sure > 0.1 * sure.max())
    if within.sum() < 4:
        return 0.0
    off = (up * solved.left).sum(axis=0)[within] / sure[within]
    return float(np.sqrt((off**2).mean()))
