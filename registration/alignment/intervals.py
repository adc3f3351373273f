"""Uncertainty of a fit's parameters.

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
from numpy.typing import NDArray

from registration.alignment.fit import Fit, Freedom, Linearised, linearised
from registration.distance import ModelSurface
from registration.uncertainty import Budget, ScanErrors, Term

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

PATCH_MM = 0.5
"""Points of one cell of this edge err together."""
BLOCK_MM = 2.5
"""Over this distance walls of one facing deviate together."""


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


@dataclass(frozen=True)
class _Errors:
    """Standard errors (k,) of a fit's parameters by each cause."""

    patches: FloatArray
    blocks: FloatArray
    level: FloatArray
    reflections: FloatArray
    block_dof: float

    def budget(self, parameter: int, errors: ScanErrors, depth: float = 0.0) -> Budget:
        """Budget of one parameter; `depth`: the beam's part along a scale's axis, squared."""
        scale = parameter >= _FIRST_SCALE and depth >= 0
        lateral = (1 - depth) * errors.lateral if scale else 0.0
        return Budget(
            (
                Term("speckle", "A", float(self.patches[parameter]), np.inf, "patches of 0.5 mm"),
                Term(
                    "shape",
                    "A",
                    float(self.blocks[parameter]),
                    self.block_dof,
                    "residuals over blocks of 2.5 mm: swelling, roughness, light",
                ),
                Term(
                    "level of the walls",
                    "B",
                    float(self.level[parameter]),
                    errors.wall_dof,
                    "halfway between liquid and gel",
                ),
                Term(
                    "reflections",
                    "B",
                    float(self.reflections[parameter]),
                    np.inf,
                    "too weak to be told from gel",
                ),
                Term(
                    "refractive index",
                    "B",
                    depth * errors.depth if scale else 0.0,
                    np.inf,
                    "depth, unless a depth standard was scanned",
                ),
                Term("voxel size", "B", lateral, np.inf, "as the file states it"),
            )
        )


_FIRST_SCALE = 6


def uncertainty(
    surface: ModelSurface,
    points: FloatArray,
    fit: Fit,
    freedom: Freedom,
    blur_mm: float,
    errors: ScanErrors,
) -> Uncertainty:
    """95 % intervals of a converged fit to scanned points (n, 3)."""
    step = linearised(surface, points, fit, freedom, blur_mm=blur_mm)
    beam = fit.rotation @ errors.beam
    causes = _causes(step, fit.apply(points), beam, errors)
    none = -1.0
    budgets = {}
    scale = np.full(3, np.nan)
    for number, axis in enumerate(freedom.axes):
        budget = causes.budget(_FIRST_SCALE + number, errors, float(beam[axis] ** 2))
        budgets[f"scale_{'xyz'[axis]}"] = budget
        scale[axis] = budget.expanded / fit.stretch[axis]
    half = np.array([causes.budget(k, errors, none).expanded for k in range(_FIRST_SCALE)])
    offset = float("nan")
    if freedom.offset:
        budgets["offset"] = causes.budget(len(causes.patches) - 1, errors, none)
        offset = budgets["offset"].expanded
    return Uncertainty(np.rad2deg(half[:3]), half[3:], scale, offset, budgets)


def _causes(step: Linearised, places: FloatArray, beam: FloatArray, errors: ScanErrors) -> _Errors:
    """Standard errors of the parameters by each cause."""
    bread = np.asarray(np.linalg.inv(step.normal), dtype=np.float64)
    scores = step.jacobian * (step.weight * step.residual)[:, None]
    patch = _numbers(np.floor(places / PATCH_MM).astype(np.int64))
    facing = _facing(step.direction, step.bends)
    cell = np.floor(places / BLOCK_MM).astype(np.int64)
    block = _numbers(np.column_stack([facing, cell]))
    pulls = step.jacobian * step.weight[:, None]
    square = (step.direction @ beam) ** 2
    light = _numbers(np.column_stack([facing, step.direction @ beam > 0]))
    spread, dof = _block_spread(step, patch, block)
    noise = _summed(scores, patch)
    count = len(noise)
    return _Errors(
        patches=_through(bread, noise) * np.sqrt(count / max(count - 1, 1)),
        blocks=spread * _through(bread, _summed(pulls, block)),
        level=errors.level_mm * _through(bread, _summed(pulls, facing)),
        reflections=errors.facing_mm * _through(bread, _summed(pulls * square[:, None], light)),
        block_dof=dof,
    )


def _through(bread: FloatArray, sums: FloatArray) -> FloatArray:
    """Standard errors of the parameters by independent pulls (g, k)."""
    return np.asarray(np.sqrt(np.maximum(np.diag(bread @ (sums.T @ sums) @ bread), 0.0)))


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


def _facing(direction: FloatArray, bends: FloatArray) -> IntArray:
    """Which of six ways each wall faces, lumens and outer faces apart."""
    axis = np.abs(direction).argmax(axis=1)
    side = direction[np.arange(len(axis)), axis] > 0
    return _numbers(np.column_stack([axis, side, np.abs(bends) > 0]).astype(np.int64))


def _numbers(keys: IntArray) -> IntArray:
    """Number of the distinct row that each row is."""
    _, found = np.unique(keys, axis=0, return_inverse=True)
    return np.asarray(found).reshape(-1)


def _summed(values: FloatArray, group: IntArray) -> FloatArray:
    """Sums of rows (n, k) over groups, (g, k)."""
    columns = [np.bincount(group, column) for column in values.T]
    return np.stack(columns, axis=1).astype(np.float64)
