"""Fit a rod model to a needle's end in a patch: end, axis, width, blur, brightness together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import FloatArray
from registration.devices.camera_frame.tip_axis import NeedleAxis
from registration.devices.camera_frame.tip_model import RodEnd
from registration.devices.camera_frame.tip_patch import TipPatch
from registration.devices.camera_frame.tip_samples import TipLight
from registration.devices.camera_frame.tip_step import USUAL_BLUR_PX, Solved, TipState, solve_step
from registration.errors import PictureError

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
_FAR: Final = 0.2
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
    state, far = solved.state, _FAR * wide
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
