"""How much perfusion each place of a tissue asks for, relative to others.

Growth that accepts a point with the probability `Demand.weight` places terminals by demand,
exactly; all terminals carry the same flow, so the tissue's total perfusion is as before and a
place's share of it is weight / mean_weight times the uniform one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from design.errors import TissueError
from design.tissue.grid import SignedDistanceGrid

if TYPE_CHECKING:
    from design.tissue.images import VolumeImage
    from design.tissue.tissue import Tissue

FloatArray = NDArray[np.float64]

_PROBES = 250_000
"""Quasi-random places in the bounding box, over which means and maxima are taken."""

_GOLDEN = 1.2207440846057596
"""Root of x⁴ = x + 1: its inverse powers fill space evenly (Roberts 2018)."""

_HEADROOM = 1.1
"""A function's greatest value is taken for at most this times the greatest found."""

_COVERED = 0.99


class Demand(Protocol):
    """Demand relative to its greatest value.

    Attributes
    ----------
    mean_weight : float
        Mean of the weight over the tissue's volume, in (0, 1].
    """

    @property
    def mean_weight(self) -> float:
        """See the class."""
        ...

    def weight(self, points: FloatArray) -> FloatArray:
        """Weight (n,) in [0, 1] at ``points`` (n, 3), mm."""
        ...


@dataclass(frozen=True)
class UniformDemand:
    """The same everywhere."""

    mean_weight: float = 1.0

    def weight(self, points: FloatArray) -> FloatArray:
        """Ones, (n,)."""
        return np.ones(len(points))


UNIFORM = UniformDemand()


@dataclass(frozen=True)
class DepthDemand:
    """A table against the depth below the surface, linear between its places and flat beyond.

    Attributes
    ----------
    grid : SignedDistanceGrid
        Of the tissue; its surface includes that of cavities and keep-out zones.
    depth_mm, level : (k,) float64
        Table, its greatest level 1.
    """

    grid: SignedDistanceGrid
    depth_mm: FloatArray
    level: FloatArray
    mean_weight: float = 1.0

    def weight(self, points: FloatArray) -> FloatArray:
        """See `Demand`."""
        depth = -self.grid.distance(points)
        found: FloatArray = np.interp(depth, self.depth_mm, self.level)
        return found


@dataclass(frozen=True)
class ImageDemand:
    """A volume image, linear between the centres of voxels.

    Attributes
    ----------
    values : (a, b, c) float64
        At most 1.
    to_index : (4, 4) float64
        From mm to voxel indices.
    """

    values: FloatArray
    to_index: FloatArray
    mean_weight: float = 1.0

    def weight(self, points: FloatArray) -> FloatArray:
        """See `Demand`; the nearest voxel's beyond the image."""
        index = np.asarray(points) @ self.to_index[:3, :3].T + self.to_index[:3, 3]
        found = map_coordinates(self.values, index.T, order=1, mode="nearest")
        return np.clip(np.asarray(found, dtype=np.float64), 0.0, 1.0)


@dataclass(frozen=True)
class FunctionDemand:
    """A function of points (n, 3), mm, that gives (n,) values.

    Attributes
    ----------
    greatest : float
        No value may be above it.
    """

    function: Callable[[FloatArray], FloatArray]
    greatest: float
    mean_weight: float = 1.0

    def weight(self, points: FloatArray) -> FloatArray:
        """See `Demand`.

        Raises
        ------
        TissueError
            When a value is negative, NaN, or above ``greatest``: rejection wouldn't be exact.
        """
        values = _values(self.function, points)
        if values.max(initial=0.0) > self.greatest * (1 + 1e-12):
            raise TissueError(
                f"demand is {values.max():.6g}, above the greatest value {self.greatest:.6g} that "
                "was found or given; pass greatest= as high as the function goes"
            )
        return np.asarray(np.minimum(values / self.greatest, 1.0))


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
    _check_values(level, "demand table")
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
    _check_values(values, "demand image")
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
    found = ImageDemand(values / greatest, to_index)
    return ImageDemand(found.values, to_index, _mean(found, tissue))


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
        greatest = _HEADROOM * float(_values(function, _probes(tissue)).max(initial=0.0))
    if not (np.isfinite(greatest) and greatest > 0):
        raise TissueError(
            f"demand's greatest value is {greatest:g}; it must ask for something in the tissue"
        )
    found = FunctionDemand(function, greatest)
    return FunctionDemand(function, greatest, _mean(found, tissue))


def _values(function: Callable[[FloatArray], FloatArray], points: FloatArray) -> FloatArray:
    values = np.asarray(function(points), dtype=np.float64)
    if values.shape != (len(points),):
        raise TissueError(
            f"demand function gave shape {values.shape} for {len(points)} points; give one value "
            "for each"
        )
    _check_values(values, "demand function")
    return values


def _check_values(values: FloatArray, what: str) -> None:
    if not np.isfinite(values).all() or values.min(initial=0.0) < 0:
        raise TissueError(f"{what} has values that are negative, NaN or infinite; give 0 or more")


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
