"""95 % intervals of a pose's fitted parameters, with an error budget by cause.

Type A: neighbouring surface points err together, so the covariance is that of sums over patches
(the sandwich of White 1980, 10.2307/1912934, clustered). Over longer ways surfaces differ from the
design too (swelling, roughness, light): the spread of mean residuals over blocks of one facing, in
excess of what patches explain, is an error of each block by itself (one-way random effects).
Type B: what no residual shows, because the fit follows it: the level of each direction of walls,
reflections of walls that face the light, the refractive index, the voxel size (`ScanErrors`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from kernels.arrays import FloatArray, IntArray
from registration.alignment.distance import ModelSurface
from registration.alignment.fit import Fit, FitFreedom, Linearised, facing, linearised
from registration.alignment.uncertainty import Budget, ScanErrors, Term

PATCH_MM = 0.5
"""Points of one cell of this edge err together."""
BLOCK_MM = 2.5
"""Over this distance walls of one facing deviate together."""
INSET_MM = 0.2


@dataclass(frozen=True)
class Uncertainty:
    """Half widths of 95 % intervals; NaN for what wasn't fitted.

    Attributes
    ----------
    rotation_deg : (3,) float64, °
        About the part's x, y, z through its middle.
    shift_mm : (3,) float64, mm
        Of the part's middle.
    scale : (3,) float64
        Of the print's size over the design's.
    offset_mm : float, mm
    budgets : dict of str to Budget
        Of "scale_x", "scale_y", "scale_z" where fitted, relative, and "offset", mm.
    """

    rotation_deg: FloatArray
    shift_mm: FloatArray
    scale: FloatArray
    offset_mm: float
    budgets: dict[str, Budget] = field(default_factory=dict)

    def of_place(self, arm: FloatArray) -> float:
        """Return how far a place may lie off in a plane through it, half width, mm.

        ``arm`` (3,) mm runs from the part's middle. Of three half widths the larger two count:
        a plane has two directions.
        """
        turn, stretch = np.deg2rad(self.rotation_deg), np.nan_to_num(self.scale) * arm
        square = self.shift_mm**2 + stretch**2
        for k in range(3):
            square[k] += (turn[k - 2] * arm[k - 1]) ** 2 + (turn[k - 1] * arm[k - 2]) ** 2
        return float(np.sqrt(np.sort(square)[1:].sum()))


@dataclass(frozen=True)
class FitErrors:
    """Errors of a fit's k parameters by cause; pulls (g, k), one row an independent source.

    Attributes
    ----------
    patches, blocks, level, reflections : (g, k) float64
        Shift of the parameters by one standard deviation of each source, rad, mm and relative.
    block_dof : float
        Degrees of freedom of `blocks`.
    """

    patches: FloatArray
    blocks: FloatArray
    level: FloatArray
    reflections: FloatArray
    block_dof: float

    @property
    def covariance(self) -> FloatArray:
        """Covariance (k, k) of the parameters, index and voxel size left out."""
        pulls = np.vstack([self.patches, self.blocks, self.level, self.reflections])
        pulls = np.nan_to_num(pulls)  # a cause that isn't known has no part in what moves freely
        return np.asarray(pulls.T @ pulls)

    def budget(self, parameter: int, errors: ScanErrors, depth: float = -1.0) -> Budget:
        """Budget of a parameter; `depth`: the beam's part along a scale's axis, squared."""
        scale = parameter >= _FIRST_SCALE and depth >= 0
        lateral = (1 - depth) * errors.lateral if scale else 0.0
        return Budget(
            (
                Term(
                    "speckle", "A", _size(self.patches[:, parameter]), np.inf, "patches of 0.5 mm"
                ),
                Term(
                    "shape",
                    "A",
                    _size(self.blocks[:, parameter]),
                    self.block_dof,
                    "residuals over blocks of 2.5 mm: swelling, roughness, light",
                ),
                Term(
                    "level of the walls",
                    "B",
                    _size(self.level[:, parameter]),
                    errors.wall_dof,
                    errors.level_note,
                ),
                Term(
                    "reflections",
                    "B",
                    _size(self.reflections[:, parameter]),
                    np.inf,
                    "too weak to be told from gel",
                ),
                Term(
                    "refractive index",
                    "B",
                    depth * errors.depth if scale else 0.0,
                    np.inf,
                    "depth, or its standard's interval",
                ),
                Term("voxel size", "B", lateral, np.inf, "the file, or its calibration"),
            )
        )


_FIRST_SCALE = 6


def uncertainty(
    spread: FitErrors, fit: Fit, freedom: FitFreedom, errors: ScanErrors
) -> Uncertainty:
    """95 % intervals of a fit's parameters."""
    beam = fit.rotation @ errors.beam
    budgets = {}
    scale = np.full(3, np.nan)
    for number, axis in enumerate(freedom.axes):
        budget = spread.budget(_FIRST_SCALE + number, errors, float(beam[axis] ** 2))
        budgets[f"scale_{'xyz'[axis]}"] = budget
        scale[axis] = budget.expanded / fit.stretch[axis]
    half = np.array([spread.budget(k, errors).expanded for k in range(_FIRST_SCALE)])
    offset = float("nan")
    if freedom.offset:
        budgets["offset"] = spread.budget(spread.patches.shape[1] - 1, errors)
        offset = budgets["offset"].expanded
    return Uncertainty(np.rad2deg(half[:3]), half[3:], scale, offset, budgets)


def fit_errors(
    surface: ModelSurface,
    points: FloatArray,
    fit: Fit,
    freedom: FitFreedom,
    errors: ScanErrors,
    *,
    lumens: bool = False,
) -> FitErrors:
    """Return the errors of a converged fit to scanned points (n, 3) by cause.

    `lumens`: the model is the lumens, so that their walls bulge; a construct's are hollow, and what
    bulges there is an outer face.
    """
    step = linearised(surface, points, fit, freedom, blur_mm=errors.blur_mm, even=True)
    bread = np.asarray(np.linalg.inv(step.normal), dtype=np.float64)
    # A face may lie on a cell's border, where noise alone would share its points out.
    places = fit.apply(points) - INSET_MM * step.direction
    patch = _numbers(np.floor(places / PATCH_MM).astype(np.int64))
    lumen = step.bends > 0 if lumens else step.bends < 0
    walls = _numbers(np.column_stack([facing(step.direction, step.bends), lumen]))
    cell = np.floor(places / BLOCK_MM).astype(np.int64)
    block = _numbers(np.column_stack([walls, cell]))
    pulls = step.jacobian * step.weight[:, None]
    along = step.direction @ (fit.rotation @ errors.beam)
    level = np.where(lumen, errors.level_mm, errors.outer_mm)
    light = _numbers(np.column_stack([walls, along > 0]))
    facing_light = errors.facing_mm * _summed(pulls * along[:, None] ** 2, light)
    noise = _summed(pulls * step.residual[:, None], patch)
    spread, dof = _block_spread(step, patch, block)
    return FitErrors(
        patches=np.sqrt(len(noise) / max(len(noise) - 1, 1)) * noise @ bread,
        blocks=spread * _summed(pulls, block) @ bread,
        level=_summed(pulls * level[:, None], walls) @ bread,
        reflections=np.vstack([errors.faint_mm * pulls.sum(axis=0), facing_light]) @ bread,
        block_dof=dof,
    )


def _size(pulls: FloatArray) -> float:
    return float(np.sqrt((pulls**2).sum()))


def _block_spread(step: Linearised, patch: IntArray, block: IntArray) -> tuple[float, float]:
    """Standard deviation of blocks' own deviation beyond that of their patches, mm, and its dof.

    By moments, weighted by points: E m² (G / (G - k)) = τ² + s², where m is a block's mean, s² that
    mean's variance by its P patches (P / (P - 1) for the mean taken off), and k parameters were
    fitted to G blocks.
    """
    weight = np.bincount(block, step.weight)
    mean = np.bincount(block, step.weight * step.residual) / np.maximum(weight, 1e-12)
    rest = step.weight * (step.residual - mean[block])
    both = _numbers(np.column_stack([block, patch]))
    inner = np.bincount(both, rest) ** 2
    of = np.zeros(int(both.max()) + 1, dtype=np.int64)
    of[both] = block
    variance = np.bincount(of, inner, len(weight)) / np.maximum(weight, 1e-12) ** 2
    patches = np.bincount(of, minlength=len(weight))
    variance *= patches / np.maximum(patches - 1, 1)
    many = patches >= LEAST_PATCHES
    dof = float(many.sum() - step.jacobian.shape[1])
    if dof < 1:
        return float("nan"), float("nan")
    share = weight[many] / weight[many].sum()
    excess = mean[many] ** 2 * many.sum() / dof - variance[many]
    return float(np.sqrt(max(float(share @ excess), 0.0))), dof


LEAST_PATCHES = 3
"""A block of fewer says nothing of its own spread."""


def _numbers(keys: IntArray) -> IntArray:
    """Number of the distinct row that each row is."""
    _, number = np.unique(keys, axis=0, return_inverse=True)
    return np.asarray(number).reshape(-1)


def _summed(values: FloatArray, group: IntArray) -> FloatArray:
    """Sums of rows (n, k) over groups, (g, k)."""
    columns = [np.bincount(group, column) for column in values.T]
    return np.stack(columns, axis=1).astype(np.float64)
