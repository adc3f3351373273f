"""Factor on a branch point's cost by its depth below the tissue's surface, sampled on a grid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from design.errors import GrowthError
from design.tissue import Tissue
from design.tissue.grid import mix
from kernels import scalar_jit
from kernels.arrays import FloatArray

SAMPLES_AT_MOST = 2_000_000
"""Of a penalty: on the tissue's own spacing where that takes no more, else on a wider one."""


class PenaltyArrays(NamedTuple):
    """A penalty as kernels take it.

    Attributes
    ----------
    on : bool
    origin : (3,) float64, mm
        Sample (0, 0, 0).
    spacing : float, mm
    values : (a, b, c) float64
        Factors; trilinear in between, constant beyond.
    """

    on: bool
    origin: FloatArray
    spacing: float
    values: FloatArray


@dataclass(frozen=True)
class DepthPenalty:
    """Factors on the cost by a branch point's depth below the tissue's surface.

    Attributes
    ----------
    depth_mm : tuple of float
        Ascending from 0 or more; linear in between, constant beyond.
    factor : tuple of float
        Above 0, one a depth. Factors above 1 drive branch points away.
    """

    depth_mm: tuple[float, ...]
    factor: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.depth_mm) != len(self.factor) or not self.depth_mm:
            raise GrowthError(
                f"penalty has {len(self.depth_mm)} depths and {len(self.factor)} factors; "
                "give one factor for each depth"
            )
        if self.depth_mm[0] < 0 or not (np.diff(self.depth_mm) > 0).all():
            raise GrowthError(f"penalty: depth_mm {self.depth_mm} doesn't ascend from 0; sort it")
        _check(np.array(self.factor))


PenaltyFunction = Callable[[FloatArray], FloatArray]
"""From points (n, 3), mm, to factors (n,) above 0."""


def no_penalty() -> PenaltyArrays:
    """A factor of 1 everywhere, never read."""
    return PenaltyArrays(False, np.zeros(3), 1.0, np.ones((2, 2, 2)))


def sample_penalty(tissue: Tissue, penalty: PenaltyFunction | DepthPenalty | None) -> PenaltyArrays:
    """Sample a penalty once, over the tissue's bounds.

    Raises
    ------
    GrowthError
        When a factor isn't a number above 0, or there isn't one for each point.
    """
    if penalty is None:
        return no_penalty()
    low, high = tissue.bounds
    coarsest = float((np.prod(high - low) / SAMPLES_AT_MOST) ** (1.0 / 3.0))
    spacing = max(tissue.grid.spacing_mm, coarsest)
    shape = np.ceil((high - low) / spacing).astype(np.int64) + 2
    axes = [low[x] + spacing * np.arange(shape[x]) for x in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    if isinstance(penalty, DepthPenalty):
        depth = -tissue.grid.distance(points)
        values = np.interp(depth, penalty.depth_mm, penalty.factor)
    else:
        values = np.asarray(penalty(points), dtype=np.float64)
    if values.shape != (len(points),):
        raise GrowthError(
            f"penalty gives an array of shape {values.shape} for {len(points)} points; return one "
            "factor for each"
        )
    _check(values)
    return PenaltyArrays(True, low.copy(), spacing, values.reshape(shape))


def _check(values: FloatArray) -> None:
    bad = values[~(np.isfinite(values) & (values > 0.0))]
    if len(bad):
        raise GrowthError(f"penalty has a factor of {bad[0]:g}; give finite factors above 0")


@scalar_jit
def read_penalty(penalty: PenaltyArrays, x: float, y: float, z: float) -> float:
    """The factor at a point."""
    h = penalty.spacing
    na, nb, nc = penalty.values.shape
    u = min(max((x - penalty.origin[0]) / h, 0.0), na - 1 - 1e-9)
    v = min(max((y - penalty.origin[1]) / h, 0.0), nb - 1 - 1e-9)
    w = min(max((z - penalty.origin[2]) / h, 0.0), nc - 1 - 1e-9)
    i, j, k = int(u), int(v), int(w)
    return float(mix(penalty.values, i, j, k, u - i, v - j, w - k))


@scalar_jit
def weigh_rise(penalty: PenaltyArrays, b: Any, base: float, rise: float) -> float:
    """What trial places are compared by: the rise, or with a penalty w (cost before + rise)."""
    if not penalty.on:
        return rise
    return read_penalty(penalty, b[0], b[1], b[2]) * (base + rise)
