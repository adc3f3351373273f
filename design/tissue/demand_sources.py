"""Make a tissue's relative perfusion demand by depth below its surface, by image or function."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from design.errors import TissueError
from design.tissue.demand import (
    Demand,
    DepthDemand,
    FunctionDemand,
    ImageDemand,
    check_values,
    checked_values,
)
from design.tissue.images import VolumeImage
from design.tissue.tissue import Tissue
from kernels.arrays import FloatArray

_PROBES = 250_000
"""Quasi-random places in the bounding box, over which means and maxima are taken."""

_GOLDEN = 1.2207440846057596
"""Root of x⁴ = x + 1: its inverse powers fill space evenly (Roberts 2018)."""

_HEADROOM = 1.1
"""A function's greatest value is taken for at most this times the greatest found."""

_COVERED = 0.99


def depth_demand(
    tissue: Tissue, depth_mm: Sequence[float], relative: Sequence[float]
) -> DepthDemand:
    """Demand by a table against the depth below the surface.

    Parameters
    ----------
    tissue : Tissue
    depth_mm : (k,) ascending, from 0 on
    relative : (k,) at least 0
        Demand there, in any unit.

    Raises
    ------
    TissueError
        When the table is impossible, or asks for nothing anywhere in the tissue.
    """
    depth, level = np.array(depth_mm, dtype=np.float64), np.array(relative, dtype=np.float64)
    if len(depth) != len(level) or len(depth) == 0:
        raise TissueError(
            f"demand has {len(depth)} depths and {len(level)} relative values; give as many"
        )
    if not np.isfinite(depth).all() or depth[0] < 0 or any(b <= a for a, b in pairwise(depth)):
        raise TissueError(f"demand: depths {depth.tolist()} mm don't ascend from 0 or more")
    check_values(level, "demand table")
    if not level.max() > 0:
        raise TissueError("demand is 0 at every depth; give some relative values above 0")
    table = DepthDemand(tissue.grid, depth, level / level.max())
    return DepthDemand(table.grid, table.depth_mm, table.level, _mean(table, tissue))


def image_demand(tissue: Tissue, image: VolumeImage) -> ImageDemand:
    """Demand by a volume image in the tissue's frame.

    Raises
    ------
    TissueError
        When values are negative or NaN, the image leaves tissue uncovered, or asks for nothing
        in it.
    """
    to_index: FloatArray = np.linalg.inv(image.affine).astype(np.float64)
    values = np.asarray(image.values, dtype=np.float64)
    check_values(values, "demand image")
    inside = _probes(tissue)
    index = inside @ to_index[:3, :3].T + to_index[:3, 3]
    covered = ((index >= -0.5) & (index <= np.array(values.shape) - 0.5)).all(axis=1).mean()
    if covered < _COVERED:
        raise TissueError(
            f"demand image covers {100 * covered:.0f} % of the tissue, below {100 * _COVERED:.0f} "
            "%; give one in the tissue's frame (the same affine as the label image) that covers it"
        )
    greatest = float(values.max())
    if not greatest > 0:
        raise TissueError("demand image is 0 everywhere; give some values above 0")
    demand = ImageDemand(values / greatest, to_index)
    return ImageDemand(demand.values, to_index, _mean(demand, tissue))


def function_demand(
    tissue: Tissue,
    function: Callable[[FloatArray], FloatArray],
    greatest: float | None = None,
) -> FunctionDemand:
    """Demand by a function of points (n, 3), mm.

    Parameters
    ----------
    greatest : float, optional
        A bound that no value exceeds; by default a tenth more than the greatest found at some
        200,000 places in the bounding box. A bound too high costs time, not exactness.

    Raises
    ------
    TissueError
        When values are negative or NaN, or 0 throughout the tissue.
    """
    if greatest is None:
        greatest = _HEADROOM * float(checked_values(function, _probes(tissue)).max(initial=0.0))
    if not (np.isfinite(greatest) and greatest > 0):
        raise TissueError(
            f"demand's greatest value is {greatest:g}; it must ask for something in the tissue"
        )
    demand = FunctionDemand(function, greatest)
    return FunctionDemand(function, greatest, _mean(demand, tissue))


def _probes(tissue: Tissue) -> FloatArray:
    """Places spread evenly over the tissue, (n, 3): an additive recurrence, always the same."""
    low, high = tissue.bounds
    step = _GOLDEN ** -np.arange(1.0, 4.0)
    points = low + ((0.5 + np.arange(_PROBES)[:, None] * step) % 1.0) * (high - low)
    return np.ascontiguousarray(points[tissue.contains(points)])


def _mean(demand: Demand, tissue: Tissue) -> float:
    """Mean weight over the tissue."""
    probes = _probes(tissue)
    mean = float(demand.weight(probes).mean()) if len(probes) else 0.0
    if not mean > 0:
        raise TissueError("demand is 0 throughout the tissue; check its frame and unit")
    return mean
