"""Find the radius factor that brings a network's arteries nearest to a published table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from design.measures.forest import Forest, forest_of
from design.measures.published_comparison import PublishedOrders, order_figures, published_orders
from design.network import VesselKind, VesselNetwork
from kernels.arrays import FloatArray

_FACTORS: Final = np.exp(0.02 * np.arange(1, 26))
"""Tried upwards and downwards: to 1.65 and 0.61, pressure drops of a seventh and the sevenfold."""

_FURTHER: Final = 6
"""Factors that are tried after the first that fits: trees grown anew differ a little."""

_FEWEST_ORDERS: Final = 4


@dataclass(frozen=True)
class PublishedMatch:
    """How near a network's arteries are to a published table.

    Attributes
    ----------
    farthest_sd : float
        Distance of the figure farthest from its published mean, in standard deviations; infinite
        where too few orders are judged.
    factor : float
        On all radii, near to 1, that would bring every figure within one standard deviation.
    """

    farthest_sd: float
    factor: float


def published_match(network: VesselNetwork, name: str) -> PublishedMatch:
    """Compare a network's arteries with a published table, and what radii would match it.

    The figures are all judged orders' diameters, lengths and slenderness and the ratios between
    orders (`compare_orders`). The factor is 1 where they are within one published standard
    deviation. Where no factor brings them within, it is the one whose farthest figure is nearest.
    A network of fewer than four judged orders keeps its radii: few vessels in a small phantom
    aren't an organ's.

    Parameters
    ----------
    network : VesselNetwork
        With arteries that branch without loops.
    name : str
        A table of `published_orders`.

    Raises
    ------
    DesignError
        When there is no table of that name.
    """
    table, forest = published_orders(name), forest_of(network, VesselKind.ARTERY)
    if forest is None:
        return PublishedMatch(np.inf, 1.0)
    length = network.lengths()[forest.vessels]
    wide = 2.0 * network.mean_radius()[forest.vessels]
    ours = _farthest_sd(table, forest, length, wide)
    if ours <= 1.0 or not np.isfinite(ours):
        return PublishedMatch(ours, 1.0)
    best, least, further = 1.0, ours, _FURTHER
    for factor in np.column_stack([_FACTORS, 1.0 / _FACTORS]).ravel().tolist():
        off = _farthest_sd(table, forest, length, factor * wide)
        if off < least:
            best, least = factor, off
        further -= least <= 1.0
        if further < 0:
            break
    return PublishedMatch(ours, best)


def _farthest_sd(
    table: PublishedOrders, forest: Forest, length: FloatArray, wide: FloatArray
) -> float:
    """See `PublishedMatch.farthest_sd`."""
    rows, ratios = order_figures(table, forest, length, wide)
    figures: list[dict[str, Any]] = [*ratios.values()]
    for row in rows:
        figures += [row["diameter_mm"], row["length_mm"], row["length_over_diameter"]]
    judged = [one for one in figures if one["inside"] is not None]
    if sum(row["diameter_mm"]["inside"] is not None for row in rows) < _FEWEST_ORDERS:
        return np.inf
    return max(abs(one["ours"] - one["mean"]) / one["sd"] for one in judged)
