"""Compare a network's arteries (counts, sizes by order) with published tables of real ones."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.errors import DesignError
from design.measures.junctions import compare_forks, measure_forks
from design.measures.morphometry import Forest, OrderTable, forest_of, order_table
from design.network import VesselKind, VesselNetwork
from kernels.arrays import FloatArray, IntArray

PUBLISHED: Final = ("coronary", "kidney", "lung", "liver")
"""Organs that there are published figures of; each file lists what is left out, and why."""
_COLUMNS = ("diameter_um", "diameter_sd_um", "length_mm", "length_sd_mm", "elements")


class JudgedLimits(NamedTuple):
    """What must be known of a figure that is judged."""

    elements: int = 5  # Of an order: the mean of fewer is scatter
    steps: int = 4  # Published steps between orders, for their spread
    orders: int = 4  # Of a network that is matched to a table: fewer are no organ's


JUDGED: Final = JudgedLimits()


@dataclass(frozen=True)
class PublishedOrders:
    """A published table, its arteries pooled.

    Attributes
    ----------
    name, source : str
    left_out : tuple of str
        What is published but isn't compared, and why.
    forks : tuple of dict
        Published angles and asymmetries: of each ``measure``, and ``at`` which forks, its mean,
        sd, source and note.
    bounds_mm : (n - 1,) float64, mm
        Diameters between orders, ((D + s) + (D' - s')) / 2 as in Kassab et al. 1993.
    diameter_mm, length_mm, slenderness : (n, 2) float64
        Mean and standard deviation of elements; NaN where there is none. Pooled as a mixture in
        equal parts: the variance is the mean of the variances, and that of the means.
    branching, diameter_ratio, length_ratio : (n - 1,) arrays of float64
        Of each order over the next, of all arteries that have both: (k, 2) order and value.
    """

    name: str
    source: str
    left_out: tuple[str, ...]
    forks: tuple[dict[str, Any], ...]
    bounds_mm: FloatArray
    diameter_mm: FloatArray
    length_mm: FloatArray
    slenderness: FloatArray
    branching: FloatArray
    diameter_ratio: FloatArray
    length_ratio: FloatArray


@cache
def published_orders(name: str) -> PublishedOrders:
    """Read a published table.

    Raises
    ------
    DesignError
        When there is none of that name.
    """
    if name not in PUBLISHED:
        raise DesignError(f"there is no published table {name}; choose {', '.join(PUBLISHED)}")
    path = Path(__file__).with_name("published") / f"{name}.json"
    data = json.loads(path.read_text(encoding="utf-8"))
    # An organ without a table has one order, of which nothing is known.
    arteries = list(data["arteries"].values()) or [[dict.fromkeys(_COLUMNS)]]
    wide, wide_sd = (
        _column(arteries, "diameter_um", 1e-3),
        _column(arteries, "diameter_sd_um", 1e-3),
    )
    long, long_sd = _column(arteries, "length_mm"), _column(arteries, "length_sd_mm")
    diameter = _pooled(wide, wide_sd)
    spread = np.nan_to_num(diameter[:, 1])
    bounds = 0.5 * ((diameter[:, 0] + spread)[:-1] + (diameter[:, 0] - spread)[1:])
    return PublishedOrders(
        data["name"],
        data["source"],
        tuple(data["left_out"]),
        tuple(data["forks"]),
        bounds,
        diameter,
        _pooled(long, long_sd),
        _pooled(long / wide, long_sd / wide),
        _steps(1.0 / _column(arteries, "elements")),
        _steps(wide),
        _steps(long),
    )


def compare_orders(network: VesselNetwork, name: str) -> dict[str, Any]:
    """The arteries' elements beside a published table, as plain numbers.

    Vessels are given the published orders, by their diameters. An order of fewer than five
    elements isn't judged, nor one below the most numerous: there the tree ends. Ratios are the
    factor from one order to the next over the orders that are judged (a straight line through
    logarithms), beside the mean and standard deviation of the published steps between the same.
    Forks' angles and asymmetries stand under ``forks``, beside published ones where there are any.

    Raises
    ------
    DesignError
        When the network has no arteries that branch without loops.
    """
    table = published_orders(name)
    forest = forest_of(network, VesselKind.ARTERY)
    if forest is None:
        raise DesignError("the network has no arteries without loops to compare; give a tree")
    wide = 2.0 * network.mean_radius()[forest.vessels]
    rows, ratios = order_figures(table, forest, network.lengths()[forest.vessels], wide)
    return {
        "table": name,
        "source": table.source,
        "left_out": list(table.left_out),
        "orders": rows if len(table.bounds_mm) else [],
        "ratios": ratios if len(table.bounds_mm) else {},
        "forks": compare_forks(measure_forks(network, forest), table.forks),
    }


def order_figures(
    table: PublishedOrders, forest: Forest, length_mm: FloatArray, diameter_mm: FloatArray
) -> tuple[list[dict[str, Any]], dict[str, dict[str, Any]]]:
    """Each order's figures and the ratios between orders, beside the published ones.

    Parameters
    ----------
    length_mm, diameter_mm : (k,) float64
        Of the forest's vessels.
    """
    order = 1 + np.searchsorted(table.bounds_mm, diameter_mm, side="right")
    present, rank = np.unique(order, return_inverse=True)
    ours = order_table(forest, rank.reshape(-1) + 1, length_mm, diameter_mm)
    enough = _judged(ours.elements)
    rows = [
        _row(table, ours, place, int(n), bool(enough[place]))
        for place, n in enumerate(present.tolist())
    ]
    judged = present[enough]
    places = np.searchsorted(present, judged)
    ratios = {
        "branching_ratio": _ratio(table.branching, 1.0 / ours.elements[places], judged),
        "diameter_ratio": _ratio(table.diameter_ratio, ours.diameter_mean_mm[places], judged),
        "length_ratio": _ratio(table.length_ratio, ours.element_length_mean_mm[places], judged),
    }
    return rows, ratios


def _judged(elements: IntArray) -> NDArray[np.bool_]:
    """Orders of enough elements, from the most numerous up: below it the tree was cut off."""
    places = np.arange(len(elements))
    judged: NDArray[np.bool_] = (elements >= JUDGED.elements) & (places >= np.argmax(elements))
    return judged


def _row(
    table: PublishedOrders, ours: OrderTable, place: int, order: int, enough: bool
) -> dict[str, Any]:
    wide = float(ours.diameter_mean_mm[place])
    long = float(ours.element_length_mean_mm[place])
    count = int(ours.elements[place])
    return {
        "order": order,
        "elements": count,
        "diameter_mm": _beside(wide, table.diameter_mm[order - 1], enough),
        "length_mm": _beside(long, table.length_mm[order - 1], enough),
        "length_over_diameter": _beside(long / wide, table.slenderness[order - 1], enough),
    }


def _beside(ours: float, published: FloatArray, judged: bool) -> dict[str, Any]:
    mean, spread = published.tolist()
    known = bool(np.isfinite(mean) and np.isfinite(spread)) and judged
    return {
        "ours": ours,
        "mean": mean if np.isfinite(mean) else None,
        "sd": spread if np.isfinite(spread) else None,
        "inside": abs(ours - mean) <= spread if known else None,
    }


def _ratio(steps: FloatArray, ours: FloatArray, orders: IntArray) -> dict[str, Any]:
    """A ratio from the means of ``orders`` beside the published steps between the same."""
    between = (steps[:, 0] >= orders.min(initial=99)) & (steps[:, 0] < orders.max(initial=0))
    values = steps[between, 1]
    if len(orders) < 2 or len(values) < 2:
        return {"ours": None, "mean": None, "sd": None, "inside": None}
    slope = float(np.polyfit(orders, np.log10(ours), 1)[0])
    published = np.array([values.mean(), values.std(ddof=1)])
    return _beside(10.0**slope, published, len(values) >= JUDGED.steps)


def _column(arteries: list[list[dict[str, Any]]], key: str, unit: float = 1.0) -> FloatArray:
    """A column of all arteries, (a, n); NaN where there is nothing."""
    return np.array(
        [[np.nan if row[key] is None else unit * row[key] for row in rows] for rows in arteries]
    )


def _pooled(mean: FloatArray, spread: FloatArray) -> FloatArray:
    """Mean and standard deviation (n, 2) of a mixture of the arteries that have both."""
    pooled = np.full((mean.shape[1], 2), np.nan)
    for n in range(mean.shape[1]):
        some = np.isfinite(mean[:, n])
        both = some & np.isfinite(spread[:, n])
        chosen = both if both.any() else some
        if chosen.any():
            pooled[n, 0] = mean[chosen, n].mean()
        if both.any():
            pooled[n, 1] = np.sqrt((spread[both, n] ** 2).mean() + mean[both, n].var())
    return pooled


def _steps(values: FloatArray) -> FloatArray:
    """Order and ratio (k, 2) of each value over that of the next lower order, of each artery."""
    ratio = values[:, 1:] / values[:, :-1]
    artery, place = np.nonzero(np.isfinite(ratio))
    return np.column_stack([place + 1.0, ratio[artery, place]])


_FACTORS: Final = np.exp(0.02 * np.arange(1, 26))
"""Tried upwards and downwards: to 1.65 and 0.61, pressure drops of a seventh and the sevenfold."""
FURTHER_FACTORS: Final = 6
"""Factors that are compared after the first of the best: trees grown anew differ a little."""


class PublishedMatch(NamedTuple):
    """How well a network's arteries match a published table."""

    within: int  # the table's figures that they have within one published standard deviation
    factor: float  # on all radii, near to 1, with which they would have most


def published_match(network: VesselNetwork, name: str) -> PublishedMatch:
    """Compare a network's arteries with a published table, and what radii would match it.

    The figures are the orders' diameters, lengths and slenderness and the ratios between orders
    (`compare_orders`). One that isn't judged counts like one outside: a match to fewer orders isn't
    better. Of the factors by which most figures are within, it is the nearest to 1, or one of the
    next whose farthest figure is nearer. A network of fewer than four judged orders keeps its
    radii: few vessels in a small phantom aren't an organ's.

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
        return PublishedMatch(0, 1.0)
    length = network.lengths()[forest.vessels]
    wide = 2.0 * network.mean_radius()[forest.vessels]
    factors = [1.0, *np.column_stack([_FACTORS, 1.0 / _FACTORS]).ravel().tolist()]
    off = [_deviations(table, forest, length, factor * wide) for factor in factors]
    within = [int((one <= 1.0).sum()) for one in off]
    most = max(within)
    if not len(off[0]) or within[0] == most:
        return PublishedMatch(within[0], 1.0)
    first = within.index(most)
    near = range(len(factors))[first : first + 1 + FURTHER_FACTORS]
    best = min(near, key=lambda n: (-within[n], off[n].max(initial=0.0)))
    return PublishedMatch(within[0], factors[best])


def _deviations(
    table: PublishedOrders, forest: Forest, length: FloatArray, wide: FloatArray
) -> FloatArray:
    """Return all judged figures' distances from their means, sd; none of too few orders."""
    rows, ratios = order_figures(table, forest, length, wide)
    figures: list[dict[str, Any]] = [*ratios.values()]
    for row in rows:
        figures += [row["diameter_mm"], row["length_mm"], row["length_over_diameter"]]
    if sum(row["diameter_mm"]["inside"] is not None for row in rows) < JUDGED.orders:
        figures = []
    judged = [one for one in figures if one["inside"] is not None]
    return np.array([abs(one["ours"] - one["mean"]) / one["sd"] for one in judged])
