"""Scale a network's radii until its orders are within published tables."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from design.measures.against import PublishedOrders, order_figures, published_orders
from design.measures.forest import Forest, forest_of
from design.network import FloatArray, VesselKind, VesselNetwork

_FACTORS: Final = np.exp(0.02 * np.arange(1, 26))
"""Tried upwards and downwards: to 1.65 and 0.61, pressure drops of a seventh and the sevenfold."""

_FEWEST_ORDERS: Final = 4

_KEPT_SD: Final = 0.95
"""Published standard deviations within which no figure asks for other radii."""

_WITHIN_SD: Final = 0.9
"""Those that every figure is brought within otherwise: growth and curves change it a little."""


def published_radius_factor(network: VesselNetwork, name: str) -> float:
    """Return the factor on all radii, nearest to 1, by which arteries match a published table.

    All judged orders' diameters, lengths and slenderness and the ratios between orders
    (`compare_orders`) are then within 0.9 published standard deviations; it is 1 where they are
    within 0.95 already. Where no factor does
    that, the one whose figure farthest off is nearest. A network of fewer than four judged orders
    keeps its radii: few vessels in a small phantom aren't an organ's.

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
        return 1.0
    length = network.lengths()[forest.vessels]
    wide = 2.0 * network.mean_radius()[forest.vessels]
    best, farthest = 1.0, _farthest_sd(table, forest, length, wide)
    if farthest <= _KEPT_SD or not np.isfinite(farthest):
        return best
    for factor in np.column_stack([_FACTORS, 1.0 / _FACTORS]).ravel().tolist():
        off = _farthest_sd(table, forest, length, factor * wide)
        if off < farthest:
            best, farthest = factor, off
        if off <= _WITHIN_SD:
            break
    return best


def _farthest_sd(
    table: PublishedOrders, forest: Forest, length: FloatArray, wide: FloatArray
) -> float:
    """Distance of the figure farthest from its published mean, in standard deviations.

    Infinite where too few orders are judged.
    """
    rows, ratios = order_figures(table, forest, length, wide)
    figures: list[dict[str, Any]] = [*ratios.values()]
    for row in rows:
        figures += [row["diameter_mm"], row["length_mm"], row["length_over_diameter"]]
    judged = [one for one in figures if one["inside"] is not None]
    if sum(row["diameter_mm"]["inside"] is not None for row in rows) < _FEWEST_ORDERS:
        return np.inf
    return max(abs(one["ours"] - one["mean"]) / one["sd"] for one in judged)
