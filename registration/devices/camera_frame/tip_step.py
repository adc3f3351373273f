"""Compute one robust Gauss-Newton step of the needle-end fit, with residuals and derivatives."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from kernels.arrays import FloatArray
from registration.devices.camera_frame.tip_model import Lattice, RodEnd, RodModel, hat_count
from registration.devices.camera_frame.tip_samples import Samples, TipLight

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
