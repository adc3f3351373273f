"""Fit the model of a needle's end to a patch: end, axis, width, blur, brightness together."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, spline_filter

from registration.camera_frame.tip_axis import NeedleAxis
from registration.camera_frame.tip_model import Lattice, RodEnd, RodModel, hat_count
from registration.camera_frame.tip_patch import TipPatch
from registration.errors import PictureError

FloatArray = NDArray[np.float64]

_ABOVE: Final = 3.0
_BELOW: Final = 1.2
_BESIDE: Final = 1.4
"""What is fitted around the end, of the width."""
_ROOM_PX: Final = 4.0
_ROWS: Final = 26
"""Samples of a width at most."""
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
_SMOOTH: Final = 0.3
"""Second differences of the brightness across, of the contrast, that are usual."""
_U_WIDE: Final = 0.007
_U_BLUR: Final = 0.5
_BLUR_PX: Final = 0.9
_BLURS_PX: Final = (0.3, 6.0)
_U_LEAN: Final = 0.03
_U_TILT: Final = 0.05
"""Usual deviations of width and end's tilt (of the width), blur (of its logarithm), and lean."""
_LEAST_CONTRAST: Final = 3.0
"""Between needle and ground, of the deviations left, over the rod's outline."""
_STEPS_PX: Final = (0.02, 0.02, 0.02)
_BLOCK: Final = 4
"""Pixels each way within which deviations are alike."""
_HUBER: Final = 2.0


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
        Contrast of the rod's outline over the deviations left.
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


@dataclass(frozen=True, eq=False)
class _State:
    """Unknowns of the fit, and what is left."""

    rod: RodEnd
    beside: float
    lean: float
    cost: float = np.inf


def fit_end(patch: TipPatch, axis: NeedleAxis, end: float) -> FittedTip:
    """Fit the end near a height and an axis that are known to a part of the width.

    Raises
    ------
    PictureError
        When nothing there stands out as a needle's end.
    """
    fit = _Fit(patch, axis)
    states = []
    for aside, up in _STARTS:
        rod = RodEnd(end + up * fit.wide, 0.0, _BLUR_PX, fit.wide)
        states.append(_State(rod, axis.beside + aside * fit.wide, axis.lean))
    for fault in _FAULTS:
        found = sorted((fit.settled(state, fault) for state in states), key=lambda one: one.cost)
        states = _apart([one for one in found if one.cost < _WORSE * found[0].cost])
    best = fit.settled(states[0], _FAULTS[-1])
    return fit.answer(best, states[1:])


def _apart(states: list[_State]) -> list[_State]:
    """Those that aren't the same as an earlier one."""
    kept: list[_State] = []
    for one in states:
        near = (
            max(abs(one.rod.end - old.rod.end), abs(one.beside - old.beside)) < _SAME_PX
            for old in kept
        )
        if not any(near):
            kept.append(one)
    return kept


class _Fit:
    """Gauss' and Newton's method with robust weights over one patch."""

    def __init__(self, patch: TipPatch, axis: NeedleAxis) -> None:
        self.patch, self.axis = patch, axis
        self.wide = patch.wide_px
        self.known = np.isfinite(patch.grey)
        if patch.ground is not None:
            self.known &= np.isfinite(patch.ground)
        level = float(np.nanmedian(patch.grey))
        self.grey = spline_filter(np.nan_to_num(patch.grey, nan=level))
        self.ground = (
            None
            if patch.ground is None
            else spline_filter(np.nan_to_num(patch.ground, nan=level))
        )
        self.count = hat_count(self.wide)
        self.noise, self.contrast = self._noise()

    def _noise(self) -> tuple[float, float]:
        """Deviation of the ground beside the needle, and the needle's contrast to it."""
        patch, axis = self.patch, self.axis
        beside = patch.beside - axis.beside - axis.lean * patch.above[:, None]
        off = patch.grey - (np.nanmedian(patch.grey) if patch.ground is None else patch.ground)
        out = off[self.known & (np.abs(beside) > 0.9 * self.wide) & (np.abs(beside) < 2 * self.wide)]
        high = patch.above[:, None] > 0
        rod = off[self.known & (np.abs(beside) < 0.5 * self.wide) & high]
        middle = float(np.median(out)) if len(out) else 0.0
        contrast = float(np.percentile(np.abs(rod - middle), 80)) if len(rod) else 0.1
        return _spread(out) if len(out) > 20 else 0.01, max(contrast, 0.02)

    def _lattice(self, rod: RodEnd) -> Lattice:
        step = max(1.0, self.wide / _ROWS)
        low, high = rod.end - _BELOW * self.wide, rod.end + _ABOVE * self.wide
        high = min(high + _ROOM_PX, self.patch.above[-3])
        heights = np.arange(low - _ROOM_PX, high, step)
        far = _BESIDE * self.wide + _ROOM_PX
        return Lattice(heights, np.arange(-far, far + step / 2, step), self._bow())

    def _bow(self) -> float:
        return self.patch.end_px / self.patch.wide_px

    def _sampled(
        self, state: _State, lattice: Lattice
    ) -> tuple[FloatArray, FloatArray | None, NDArray[np.bool_]]:
        """Picture and ground around a rod, and where they are known."""
        heights = lattice.heights[:, None]
        wider = 1 + self.patch.taper * (heights - state.rod.end)
        columns = (state.beside + state.lean * heights + lattice.beside * wider
                   - self.patch.beside[0])  # fmt: skip
        rows = np.broadcast_to(heights - self.patch.above[0], columns.shape)
        at = [rows, columns]
        seen = map_coordinates(self.grey, at, order=3, prefilter=False, mode="nearest")
        ground = (
            None
            if self.ground is None
            else map_coordinates(self.ground, at, order=3, prefilter=False, mode="nearest")
        )
        known = map_coordinates(self.known.astype(np.float64), at, order=1, cval=0.0) > 0.99
        return np.asarray(seen), ground, known

    def settled(self, state: _State, fault: float) -> _State:
        """The least sum of squares near a state."""
        self.size = float(np.hypot(self.noise, fault * self.contrast))
        self.held = fault > _FAULTS[1]
        for _ in range(_ROUNDS):
            self._solve(state)
            moved = self._moved(state)
            way = max(
                abs(moved.rod.end - state.rod.end), abs(moved.beside - state.beside),
                abs(moved.rod.tilt - state.rod.tilt),
            )  # fmt: skip
            state = moved
            if way < max(_STILL_PX, fault):
                break
        self._solve(state)
        return replace(state, cost=self.cost)

    def _moved(self, state: _State) -> _State:
        """One step, no farther than a part of the width."""
        far = 0.2 * self.wide
        end, tilt, aside, lean, blur, wide = self.step
        rod = RodEnd(
            state.rod.end + float(np.clip(end, -far, far)),
            float(np.clip(state.rod.tilt + np.clip(tilt, -far, far), -self.wide, self.wide)),
            float(np.clip(state.rod.blur * np.exp(np.clip(blur, -0.5, 0.5)), *_BLURS_PX)),
            float(np.clip(state.rod.wide + wide, 0.85 * self.wide, 1.15 * self.wide)),
        )
        return _State(
            rod,
            state.beside + float(np.clip(aside, -far, far)),
            state.lean + float(np.clip(lean, -0.03, 0.03)),
        )

    def _solve(self, state: _State) -> None:
        """Levels at a state, then the step of all unknowns; sets step, cost and all for `answer`."""
        rod, lattice = state.rod, self._lattice(state.rod)
        seen, ground, known = self._sampled(state, lattice)
        model = RodModel(rod, lattice, self.count)
        shapes, cover = model.shapes(), model.cover()
        behind = _behind(lattice, ground, self.wide)
        terms = np.concatenate([shapes, (1 - cover) * behind])
        fixed = np.zeros_like(seen) if ground is None else (1 - cover) * ground
        bends = self._bends(len(behind)) / (_SMOOTH * self.contrast)
        weight = known / self.size**2
        for _ in range(3):
            levels = _levels(terms, seen - fixed, weight, bends)
            left = seen - fixed - np.tensordot(levels, terms, 1)
            off = np.abs(left) / self.size
            weight = known * np.where(off > _HUBER, _HUBER / np.maximum(off, _HUBER), 1.0)
            weight /= self.size**2
        slopes = self._slopes(state, lattice, levels, behind, ground)
        self._step(state, terms, slopes, left, weight, bends, levels)
        self.left, self.weight, self.cover = left, weight, cover
        self.slopes, self.lattice = slopes, lattice

    def _bends(self, more: int) -> FloatArray:
        """Second differences of the brightness across and zeros, over all levels."""
        count = self.count
        bends = np.zeros((count - 2, count + 3 + more))
        for n in range(count - 2):
            bends[n, n : n + 3] = [1.0, -2.0, 1.0]
        return bends

    def _slopes(
        self, state: _State, lattice: Lattice, levels: FloatArray, behind: FloatArray,
        ground: FloatArray | None,
    ) -> FloatArray:  # fmt: skip
        """How the model changes with end, tilt, place aside, lean, log blur, width; (6, k, m)."""
        rod, many = state.rod, self.count + 3
        back = np.tensordot(levels[many:], behind, 1) + (0.0 if ground is None else ground)

        def picture(one: RodEnd, aside: float = 0.0) -> FloatArray:
            model = RodModel(one, lattice, self.count, aside)
            return np.asarray(model.light(levels[:many]) + (1 - model.cover()) * back)

        d = _STEPS_PX[0]
        plain = picture(rod)
        up = (picture(replace(rod, end=rod.end + d)) - plain) / d
        tilt = (picture(replace(rod, tilt=rod.tilt + d)) - plain) / d
        aside = (picture(rod, d) - picture(rod, -d)) / (2 * d)
        blur = (picture(replace(rod, blur=rod.blur * (1 + d))) - plain) / d
        wide = (picture(replace(rod, wide=rod.wide + d)) - plain) / d
        return np.array([up, tilt, aside, aside * lattice.heights[:, None], blur, wide])

    def _step(
        self, state: _State, terms: FloatArray, slopes: FloatArray, left: FloatArray,
        weight: FloatArray, bends: FloatArray, levels: FloatArray,
    ) -> None:  # fmt: skip
        """Step of all unknowns together, and the products of their slopes."""
        many = len(slopes)
        by = np.concatenate([slopes, terms]).reshape(many + len(terms), -1)
        normal = (by * weight.ravel()) @ by.T
        pull = by @ (weight * left).ravel()
        held = 0.01 if self.held else 1.0
        tilt = np.hypot(_U_TILT * self.wide, state.rod.tilt)  # a worn end's is larger
        sure = np.array([
            1e6, held * tilt, 1e6, _U_LEAN, _U_BLUR, held * _U_WIDE * self.wide,
        ])  # fmt: skip
        now = np.array([
            0.0, state.rod.tilt, 0.0, state.lean - self.axis.lean,
            np.log(state.rod.blur / _BLUR_PX), state.rod.wide - self.wide,
        ])  # fmt: skip
        normal[:many, :many] += np.diag(sure**-2.0)
        pull[:many] -= now / sure**2
        normal[many:, many:] += bends.T @ bends
        pull[many:] -= bends.T @ (bends @ levels)
        normal += np.diag(1e-9 * np.diag(normal) + 1e-12)
        self.normal = normal
        self.step = np.linalg.solve(normal, pull)[:many]
        self.cost = float((weight * left**2).sum() + ((now / sure) ** 2).sum())
        self.cost += float(((bends @ levels) ** 2).sum())

    def answer(self, best: _State, others: list[_State]) -> FittedTip:
        """The end with its uncertainty; places that fit as well are in it."""
        clear = self._clear()
        if clear < _LEAST_CONTRAST or not np.isfinite(best.cost):
            raise PictureError(
                f"the needle's end isn't clear: its outline is {clear:.1f} of what is left around "
                f"it ({_LEAST_CONTRAST:g} wanted); put a plain ground of another brightness behind "
                "the tip, or give pictures with the needle at other places"
            )
        alike = self._alike()
        covariance = np.linalg.inv(self.normal)[:6, :6] * alike
        # Aside at the end is beside + lean · end.
        by = np.array([[1.0, 0, 0, 0, 0, 0], [best.lean, 0, 1.0, best.rod.end, 0, 0]])
        lever = by @ covariance @ by.T
        for other in others:
            apart = np.array([other.rod.end - best.rod.end, other.beside - best.beside])
            if other.cost - best.cost < _ALIKE * alike and np.abs(apart).max() > 0.1:
                lever = lever + np.outer(apart, apart) / 2
        return FittedTip(
            best.rod.end,
            best.beside + best.lean * best.rod.end,
            lever,
            best.rod.wide,
            float(np.sqrt(covariance[5, 5])),
            2 * best.rod.tilt / best.rod.wide,
            2 * float(np.sqrt(covariance[1, 1])) / best.rod.wide,
            best.lean,
            self._rough() / self.wide,
            clear,
        )

    def _alike(self) -> float:
        """By how much blocks of pixels deviate more than if each pixel did for itself."""
        off = np.sqrt(self.weight) * self.left
        rows, columns = (side // _BLOCK * _BLOCK for side in off.shape)
        blocks = off[:rows, :columns].reshape(rows // _BLOCK, _BLOCK, columns // _BLOCK, _BLOCK)
        sums = blocks.sum(axis=(1, 3)) / _BLOCK
        return max(1.0, float((sums**2).mean()))

    def _clear(self) -> float:
        """Mean contrast of the outline over what is left beside it."""
        outline = np.abs(self.slopes[[0, 2]]).max(axis=0)
        near = outline > 0.3 * outline.max()
        left = np.sqrt((self.left[near] ** 2).mean()) + 1e-6
        return float(self.contrast / left)

    def _rough(self) -> float:
        """RMS by which the end deviates in columns from the flat one, px."""
        up = self.slopes[0]
        within = np.abs(self.lattice.beside) < 0.42 * self.wide
        sure = (up**2).sum(axis=0)
        within &= sure > 0.1 * sure.max()
        if within.sum() < 4:
            return 0.0
        off = (up * self.left).sum(axis=0)[within] / sure[within]
        return float(np.sqrt((off**2).mean()))


def _behind(lattice: Lattice, ground: FloatArray | None, wide: float) -> FloatArray:
    """Shapes of which the ground, or its difference from the known one, is made."""
    x = np.broadcast_to(lattice.beside / wide, (len(lattice.heights), len(lattice.beside)))
    y = np.broadcast_to(((lattice.heights - lattice.heights.mean()) / wide)[:, None], x.shape)
    plain = [np.ones_like(x), x, y]
    if ground is None:
        plain += [x * x, x * y, y * y, np.tanh(4 * x)]
    return np.array(plain)


def _levels(
    terms: FloatArray, wanted: FloatArray, weight: FloatArray, bends: FloatArray
) -> FloatArray:
    by = terms.reshape(len(terms), -1)
    normal = (by * weight.ravel()) @ by.T + bends.T @ bends
    normal += np.diag(1e-9 * np.diag(normal) + 1e-12)
    return np.asarray(np.linalg.solve(normal, by @ (weight * wanted).ravel()))


def _spread(values: FloatArray) -> float:
    return max(1.4826 * float(np.median(np.abs(values - np.median(values)))), 1e-3)
