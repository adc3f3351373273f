"""Fit a scan's pose finely: robust Gauss-Newton on exact signed distances, rigid or with scales."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from kernels.arrays import FloatArray
from registration.alignment.distance import UNKNOWN, ModelSurface

FINEST_SCALE_MM = 0.01
"""Three times this is the least at which the robust loss calls a point an outlier. With twice as
much one vessel that is wider than designed all along shifts the scales by 0.3 %."""


@dataclass(frozen=True)
class Fit:
    """A map from scan to part: p = centre + stretch · (rotation · q + shift - centre).

    Attributes
    ----------
    rotation : (3, 3) float64
        A proper rotation.
    shift : (3,) float64, mm
        Translation.
    stretch : (3,) float64
        Along the part's axes; 1 for a rigid fit. The print's size over the design's is
        ``1 / stretch``.
    centre : (3,) float64, mm
        The part's middle, which a stretch leaves in place.
    offset_mm : float, mm
        Mean distance that no map takes away: surface outside the model (beads that spread) is
        above 0. Estimated beside the scales, because it would otherwise be read as scale; it
        isn't part of the map.
    walls_mm : (facing, outer), mm
        The same, beyond the offset, of walls that face the light or away from it (reflections), and
        of outer walls along it (A-scans half in gel); between, by the square of the normal's part
        along the light. Either lies on opposite ends of the part, and would be read as scale.
    """

    rotation: FloatArray
    shift: FloatArray
    stretch: FloatArray
    centre: FloatArray
    offset_mm: float = 0.0
    walls_mm: tuple[float, float] = (0.0, 0.0)

    @property
    def matrix(self) -> FloatArray:
        """The map as (4, 4) homogeneous matrix, scan to part."""
        out = np.eye(4)
        out[:3, :3] = self.stretch[:, None] * self.rotation
        out[:3, 3] = self.centre + self.stretch * (self.shift - self.centre)
        return out

    @property
    def scale(self) -> FloatArray:
        """Size of the print over that of the design along x, y, z."""
        return np.asarray(1.0 / self.stretch)

    def apply(self, points: FloatArray) -> FloatArray:
        """Scan positions (n, 3) to part positions."""
        return np.asarray(points @ self.matrix[:3, :3].T + self.matrix[:3, 3])

    def invert(self, points: FloatArray) -> FloatArray:
        """Part positions (n, 3) to scan positions."""
        inverse = np.linalg.inv(self.matrix)
        return np.asarray(points @ inverse[:3, :3].T + inverse[:3, 3])


@dataclass(frozen=True)
class FitFreedom:
    """What a fit may change beside rotation and shift.

    Attributes
    ----------
    axes : tuple of int
        Part axes that may stretch.
    offset : bool
        Whether a uniform offset of the surface is estimated beside them.
    walls_mm : (facing, outer), mm
        Standard uncertainties of `Fit.walls_mm` before the fit; what isn't 0 is estimated too.
    beam : (3,) float64
        Unit vector of the light's way, in the scan's frame.
    """

    axes: tuple[int, ...] = ()
    offset: bool = False
    walls_mm: tuple[float, float] = (0.0, 0.0)
    beam: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    @property
    def kinds(self) -> list[int]:
        """Which of `walls_mm` are estimated."""
        return np.flatnonzero(self.walls_mm).tolist()


RIGID = FitFreedom()

_STRETCH_PRIOR = 0.05
_OFFSET_PRIOR_MM = 0.1


def refine(
    surface: ModelSurface,
    points: FloatArray,
    start: Fit,
    freedom: FitFreedom,
    *,
    steps: int = 40,
    kernel_mm: float | None = None,
    blur_mm: float = 0.0,
    settled_mm: float = 1e-5,
    even: bool = False,
) -> Fit:
    """Improve `start` until nothing moves by more than `settled_mm`.

    Residuals are exact signed distances, weighted after Geman & McClure at `kernel_mm`, or at
    three times their own spread, less what a blur of the volume by `blur_mm` has moved the surface
    (`ModelSurface.blurred`). Weak priors (stretch within 5 %, offset within 0.1 mm) keep a
    model without depth or without lumens solvable; against thousands of points they weigh nothing.
    `even`: sides of the part that are ragged weigh less, see `evenness`; near the answer only.
    """
    fit, face = start, UNKNOWN
    reach = float(np.linalg.norm(surface.bounds[1] - surface.bounds[0])) / 2
    for _ in range(steps):
        now = linearised(surface, points, fit, freedom, kernel_mm, blur_mm, even, face)
        step, face = now.step, now.face
        fit = _advance(fit, step, freedom)
        largest = max(np.abs(step[:3]).max() * reach, np.abs(step[3:6]).max(), 0.0)
        if max(largest, np.abs(step[6:]).max(initial=0.0) * reach) < settled_mm:
            break
    return fit


@dataclass(frozen=True)
class Linearised:
    """A fit's least squares about where it is, over n points and k parameters.

    Attributes
    ----------
    jacobian : (n, k) float64
        Derivatives of the residuals by rotation about the centre, shift, log stretches, both
        kinds of walls, offset.
    residual, weight : (n,) float64
        Signed distance less what the blur and the offsets explain, mm; and its robust weight.
    normal : (k, k) float64
        Normal matrix, priors included.
    step : (k,) float64
        To the next fit.
    direction : (n, 3) float64
        Of growing distance.
    bends : (n,) float64, 1/mm
        The model's curvature there.
    face : (n,) int64
        Its nearest triangle.
    """

    jacobian: FloatArray
    residual: FloatArray
    weight: FloatArray
    normal: FloatArray
    step: FloatArray
    direction: FloatArray
    bends: FloatArray
    face: NDArray[np.int64]


def linearised(
    surface: ModelSurface,
    points: FloatArray,
    fit: Fit,
    freedom: FitFreedom,
    kernel_mm: float | None = None,
    blur_mm: float = 0.0,
    even: bool = False,
    guesses: NDArray[np.int64] = UNKNOWN,
) -> Linearised:
    """One Gauss-Newton step of `refine`, and what it was made of.

    `guesses`: see `ModelSurface.query`.
    """
    rigid = points @ fit.rotation.T + fit.shift
    near = surface.query(fit.centre + fit.stretch * (rigid - fit.centre), guesses)
    bends = surface.curvature[near.face]
    along = (near.direction @ (fit.rotation @ freedom.beam)) ** 2
    kinds = np.column_stack([along, (1 - along) * (bends >= 0)])
    explained = fit.offset_mm + kinds @ fit.walls_mm
    residual = near.distance - surface.blurred(near.face, blur_mm) - explained
    spread = 1.4826 * float(np.median(np.abs(residual)))
    scale = kernel_mm or 3 * max(spread, FINEST_SCALE_MM)
    weight = (scale**2 / (scale**2 + residual**2)) ** 2
    if even:
        weight *= evenness(residual, facing(near.direction, bends))
    jacobian = _jacobian(near.direction, rigid, kinds, fit, freedom)
    prior, pull = _priors(fit, freedom, scale)
    weighted = jacobian * weight[:, None]
    normal = weighted.T @ jacobian + np.diag(prior + 1e-9)
    step = np.asarray(np.linalg.solve(normal, pull - weighted.T @ residual), dtype=np.float64)
    return Linearised(jacobian, residual, weight, normal, step, near.direction, bends, near.face)


def facing(direction: FloatArray, bends: FloatArray) -> NDArray[np.int64]:
    """Number of each wall's side (n,): which of six ways it faces, flat and bent walls apart."""
    axis = np.abs(direction).argmax(axis=1)
    high = direction[np.arange(len(axis)), axis] > 0
    return np.asarray(4 * axis + 2 * high + (bends != 0), dtype=np.int64)


def evenness(residual: FloatArray, side: NDArray[np.int64]) -> FloatArray:
    """Weight of each point by how evenly its side lies about its own median, (n,), at most 1.

    A face that light reached badly is ragged: its points scatter, and not about the face. Sides
    count by the inverse of their variance, as in least squares of unequal groups, against the
    median side's.
    """
    sides = np.unique(side)
    spread = np.empty(len(sides))
    for k, number in enumerate(sides):
        own = residual[side == number]
        spread[k] = 1.4826 * np.median(np.abs(own - np.median(own)))
    usual = max(float(np.median(spread)), FINEST_SCALE_MM)
    factor = np.minimum(1.0, (usual / np.maximum(spread, 1e-9)) ** 2)
    return np.asarray(factor[np.searchsorted(sides, side)])


def _jacobian(
    gradient: FloatArray, rigid: FloatArray, kinds: FloatArray, fit: Fit, freedom: FitFreedom
) -> FloatArray:
    """Derivatives of the residuals, see `Linearised`; `kinds`: how much each wall is of either."""
    stretched = gradient * fit.stretch
    columns = [np.cross(rigid - fit.centre, stretched), stretched]
    moved = fit.stretch * (rigid - fit.centre)
    columns += [(gradient[:, k] * moved[:, k])[:, None] for k in freedom.axes]
    columns.append(-kinds[:, freedom.kinds])
    if freedom.offset:
        columns.append(np.full((len(rigid), 1), -1.0))
    return np.concatenate(columns, axis=1)


def _priors(fit: Fit, freedom: FitFreedom, noise: float) -> tuple[FloatArray, FloatArray]:
    """Weight and pull of the priors, for each parameter."""
    now = [0.0] * 6 + [float(np.log(fit.stretch[k])) for k in freedom.axes]
    now += [fit.walls_mm[k] for k in freedom.kinds]
    sigma = [np.inf] * 6 + [_STRETCH_PRIOR] * len(freedom.axes)
    sigma += [freedom.walls_mm[k] for k in freedom.kinds]
    if freedom.offset:
        now.append(fit.offset_mm)
        sigma.append(_OFFSET_PRIOR_MM)
    weight = (noise / np.array(sigma)) ** 2
    return weight, -weight * np.array(now)


def _advance(fit: Fit, step: FloatArray, freedom: FitFreedom) -> Fit:
    turn = Rotation.from_rotvec(step[:3]).as_matrix()
    stretch, walls = fit.stretch.copy(), list(fit.walls_mm)
    for number, axis in enumerate(freedom.axes):
        stretch[axis] *= np.exp(np.clip(step[6 + number], -0.05, 0.05))
    for number, kind in enumerate(freedom.kinds, 6 + len(freedom.axes)):
        walls[kind] += float(step[number])
    return replace(
        fit,
        rotation=turn @ fit.rotation,
        shift=turn @ (fit.shift - fit.centre) + fit.centre + step[3:6],
        stretch=stretch,
        offset_mm=fit.offset_mm + (float(step[-1]) if freedom.offset else 0.0),
        walls_mm=(walls[0], walls[1]),
    )
