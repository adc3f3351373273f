"""Sample demand in each terminal's territory (Voronoi cell); compare with the terminal's flow.

A terminal's territory is the part of the tissue that is nearer to it than to any other terminal
(its Voronoi cell). Its demand is measured on points that fill the tissue evenly, weighed by
demand.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from design.errors import DesignError
from design.tissue import Tissue
from kernels.arrays import FloatArray

PER_TERMINAL, AT_LEAST, AT_MOST = 400, 100_000, 4_000_000
"""Points by which territories are measured."""

_GOLDEN = 1.2207440846057596
"""Root of x⁴ = x + 1: its inverse powers fill space evenly (Roberts 2018)."""


@dataclass(frozen=True)
class SupplyBalance:
    """Supply over demand of the terminals' territories; 1 is just what each asks for.

    Attributes
    ----------
    terminals : int
    spread : float
        Standard deviation of supply over demand, weighed by demand.
    p5, p95 : float
        Percentiles by demand: so much of the tissue's demand is served worse, or better.
    worst : float
        The least.
    worst_at_mm : (float, float, float)
        Its terminal.
    sampling : float
        Spread that random points of this number would show, were all territories alike; these
        points show less.
    """

    terminals: int
    spread: float
    p5: float
    p95: float
    worst: float
    worst_at_mm: tuple[float, float, float]
    sampling: float


def demand_points(
    tissue: Tissue,
    count: int,
    seed: int,
    owns: Callable[[FloatArray], NDArray[np.bool_]] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """So many points (n, 3) in the tissue, mm, and the demand's weight there (n,).

    Only points that ``owns`` says True of are taken.
    """
    low, high = tissue.bounds
    step = _GOLDEN ** -np.arange(1.0, 4.0)
    at = np.random.default_rng([seed, 0x7E44]).uniform(size=3)
    parts = [np.empty((0, 3))]
    size = 0
    while size < count:
        tried = low + ((at + np.arange(1, count + 1)[:, None] * step) % 1.0) * (high - low)
        at = (at + count * step) % 1.0
        tried = tried[tissue.contains(tried)]
        parts.append(tried if owns is None else tried[owns(tried)])
        size += len(parts[-1])
    points = np.concatenate(parts)[:count]
    return points, tissue.demand.weight(points)


def points_for(terminals: int) -> int:
    """How many points suit so many territories."""
    return int(np.clip(PER_TERMINAL * terminals, AT_LEAST, AT_MOST))


def territory_demand(points: FloatArray, weight: FloatArray, tips: FloatArray) -> FloatArray:
    """Each terminal's share of the demand, (k,); their sum is 1.

    Parameters
    ----------
    points, weight : (n, 3), (n,) float64
        As `demand_points` gives them.
    tips : (k, 3) float64, mm
    """
    _, owner = KDTree(tips).query(points)
    share: FloatArray = np.bincount(owner, weights=weight, minlength=len(tips)) / weight.sum()
    return share


def supply_balance(
    tissue: Tissue, tips: FloatArray, flow: FloatArray, seed: int = 1
) -> SupplyBalance:
    """Compare terminals' flows with their territories' demand.

    Parameters
    ----------
    tissue : Tissue
    tips : (k, 3) float64, mm
    flow : (k,) float64
        In any unit.
    seed : int
        Of the points.

    Raises
    ------
    DesignError
        When there is no terminal, or no flow.
    """
    if len(tips) == 0 or len(tips) != len(flow) or not float(flow.sum()) > 0.0:
        raise DesignError(
            f"{len(tips)} terminals with {len(flow)} flows can't be compared with the tissue's "
            "demand; give a flow for each"
        )
    points, weight = demand_points(tissue, points_for(len(tips)), seed)
    demand = territory_demand(points, weight, tips)
    # A territory that no point fell into asks for less than half a point.
    seen = np.maximum(demand, 0.5 * float(weight.mean()) / float(weight.sum()))
    ratio = (flow / flow.sum()) / seen
    order = np.argsort(ratio, kind="stable")
    below = np.cumsum(demand[order])
    low, high = (ratio[order][min(np.searchsorted(below, p), len(tips) - 1)] for p in (0.05, 0.95))
    worst = int(order[0])
    return SupplyBalance(
        terminals=len(tips),
        spread=float(np.sqrt((demand * (ratio - 1.0) ** 2).sum())),
        p5=float(low),
        p95=float(high),
        worst=float(ratio[worst]),
        worst_at_mm=(float(tips[worst, 0]), float(tips[worst, 1]), float(tips[worst, 2])),
        sampling=float(np.sqrt(len(tips) / len(points))),
    )
