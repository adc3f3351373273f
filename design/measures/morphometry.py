"""Measure counts, lengths and diameters of vessels by Strahler order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from design.network import VesselKind, VesselNetwork
from kernels import jit
from kernels.arrays import FloatArray, IntArray

MAX_ROUNDS = 3
SETTLED_CHANGE = 0.01
"""Of the orders' mean diameters: see `diameter_defined_orders`."""


@dataclass(frozen=True)
class OrderTable:
    """Vessels by order, 1 for the smallest.

    A segment is a vessel between two nodes; an element is a run of segments of one order in
    series.

    Attributes
    ----------
    segments, elements : (n,) int64
        How many.
    diameter_mean_mm, diameter_sd_mm : (n,) float64, mm
        Of elements, each the mean of its segments.
    segment_length_mean_mm, element_length_mean_mm, element_length_sd_mm : (n,) float64, mm
    connectivity : (n, n) float64
        Elements of order row + 1 that spring from one of order column + 1, on average.
    branching_ratio : float or None
        Elements of one order over those of the next higher one, from a straight line through the
        logarithms of the counts; None with fewer than two orders.
    diameter_ratio, length_ratio : float or None
        Mean diameters and element lengths of one order over those of the next lower one, the same
        way; below 1 where they fall. A top order that holds nothing but stems, whose length is
        the way from the inlet to the first fork, doesn't count where two others are left.
    """

    segments: IntArray
    elements: IntArray
    diameter_mean_mm: FloatArray
    diameter_sd_mm: FloatArray
    segment_length_mean_mm: FloatArray
    element_length_mean_mm: FloatArray
    element_length_sd_mm: FloatArray
    connectivity: FloatArray
    branching_ratio: float | None
    diameter_ratio: float | None
    length_ratio: float | None


@dataclass(frozen=True)
class Morphometry:
    """Orders of all vessels of one kind that branch without loops.

    Attributes
    ----------
    kind : VesselKind
    vessels : (k,) int64
        Their numbers in the network.
    strahler_order, diameter_order : (k,) int64
        Of each of them.
    diameter_order_change : float
        Of the last round that found them, see `diameter_defined_orders`.
    strahler, diameter_defined : OrderTable
    """

    kind: VesselKind
    vessels: IntArray
    strahler_order: IntArray
    diameter_order: IntArray
    diameter_order_change: float
    strahler: OrderTable
    diameter_defined: OrderTable


def measure_morphometry(network: VesselNetwork) -> tuple[Morphometry, ...]:
    """Morphometry of each kind of vessel; a kind whose vessels have loops has no orders."""
    length, diameter = network.lengths(), 2.0 * network.mean_radius()
    by_kind = []
    for kind in VesselKind:
        forest = forest_of(network, kind)
        if forest is None:
            continue
        long, wide = length[forest.vessels], diameter[forest.vessels]
        plain = strahler_orders(forest.parent, forest.order)
        defined, change = diameter_defined_orders(wide, plain)
        by_kind.append(
            Morphometry(
                kind,
                forest.vessels,
                plain,
                defined,
                change,
                order_table(forest, plain, long, wide),
                order_table(forest, defined, long, wide),
            )
        )
    return tuple(by_kind)


def network_strahler_orders(network: VesselNetwork) -> FloatArray:
    """Strahler's order of each vessel, (v,), 1 for terminals; NaN for kinds with loops."""
    values = np.full(network.vessel_count, np.nan)
    for kind in VesselKind:
        forest = forest_of(network, kind)
        if forest is not None:
            values[forest.vessels] = strahler_orders(forest.parent, forest.order)
    return values


def diameter_defined_orders(diameter: FloatArray, strahler: IntArray) -> tuple[IntArray, float]:
    """Orders by ranges of diameter, found from Strahler's by iteration.

    The bound between orders n and n + 1 is ((D̄ₙ + sₙ) + (D̄ₙ₊₁ - sₙ₊₁)) / 2 with mean and
    standard deviation of each order's segments; vessels are ordered anew by their diameter
    (Kassab et al. 1993, doi 10.1152/ajpheart.1993.265.1.H350; Jiang et al. 1994,
    doi 10.1152/jappl.1994.76.2.882) until no mean changes by 1 %, three times at most. Real
    vessels settle by then; the diameters of a grown tree leave no gaps between orders, and
    further rounds only creep, until its orders merge. An order left without vessels is dropped.

    Parameters
    ----------
    diameter : (k,) float64, mm
    strahler : (k,) int64
        Where to begin.

    Returns
    -------
    (k,) int64
        Orders from 1.
    float
        The greatest relative change of an order's mean diameter in the last round.
    """
    orders = _compact(strahler)
    change = 0.0
    mean, spread = _mean_spread(diameter, orders)
    for _ in range(MAX_ROUNDS):
        bounds = 0.5 * ((mean + spread)[:-1] + (mean - spread)[1:])
        # Orders that overlap widely could cross their bounds.
        bounds = np.maximum.accumulate(bounds)
        orders = _compact(np.searchsorted(bounds, diameter, side="right"))
        before = mean
        mean, spread = _mean_spread(diameter, orders)
        if len(mean) != len(before):
            change = 1.0
            continue
        change = float(np.abs(mean / before - 1.0).max())
        if change < SETTLED_CHANGE:
            break
    return orders + 1, change


def _compact(orders: IntArray) -> IntArray:
    """Orders numbered from 0 without gaps."""
    return np.unique(orders, return_inverse=True)[1].reshape(-1)


def _mean_spread(values: FloatArray, orders: IntArray) -> tuple[FloatArray, FloatArray]:
    """Mean and standard deviation by order, from 0."""
    count = np.bincount(orders)
    mean = np.bincount(orders, values) / count
    return mean, np.sqrt(np.bincount(orders, (values - mean[orders]) ** 2) / count)


def order_table(
    forest: Forest, rank: IntArray, length: FloatArray, diameter: FloatArray
) -> OrderTable:
    """Count, length and diameter of segments and elements of each order.

    Parameters
    ----------
    forest : Forest
    rank : (k,) int64
        Orders, from 1, none skipped.
    length, diameter : (k,) float64, mm
        Of the forest's vessels.
    """
    element = elements_of(forest.parent, forest.order, rank, diameter)
    parts = np.bincount(element)
    of = np.zeros(len(parts), dtype=np.int64)
    of[element] = rank
    orders = int(rank.max())
    wide = np.bincount(element, diameter) / parts
    long = np.asarray(np.bincount(element, length), dtype=np.float64)
    elements = np.bincount(of, minlength=orders + 1)[1:].astype(np.int64)
    segments = np.bincount(rank, minlength=orders + 1)[1:].astype(np.int64)
    stems = len(np.unique(element[forest.parent < 0]))
    fitted = orders - 1 if orders > 2 and elements[-1] == stems else orders
    mean, spread = _mean_spread(wide, of - 1)
    mean_length, spread_length = _mean_spread(long, of - 1)
    return OrderTable(
        segments=segments,
        elements=elements,
        diameter_mean_mm=mean,
        diameter_sd_mm=spread,
        segment_length_mean_mm=np.bincount(rank, length, minlength=orders + 1)[1:] / segments,
        element_length_mean_mm=mean_length,
        element_length_sd_mm=spread_length,
        connectivity=_connectivity(forest, element, rank, elements),
        branching_ratio=_ratio(1.0 / elements),
        diameter_ratio=_ratio(mean[:fitted]),
        length_ratio=_ratio(mean_length[:fitted]),
    )


def _connectivity(
    forest: Forest, element: IntArray, rank: IntArray, elements: IntArray
) -> FloatArray:
    child = np.flatnonzero(forest.parent >= 0)
    parent = forest.parent[child]
    springs = element[child] != element[parent]
    table = np.zeros((len(elements), len(elements)))
    np.add.at(table, (rank[child[springs]] - 1, rank[parent[springs]] - 1), 1.0)
    return table / elements


def _ratio(values: FloatArray) -> float | None:
    """Factor from one order to the next."""
    if len(values) < 2:
        return None
    slope = float(np.polyfit(np.arange(len(values)), np.log10(values), 1)[0])
    return float(10.0**slope)


@dataclass(frozen=True)
class Forest:
    """Vessels that branch from roots without loops, with the flow or against it (veins).

    Attributes
    ----------
    vessels : (k,) int64
        Their numbers in the network.
    parent : (k,) int64
        Place of each one's parent among ``vessels``, -1 for a root.
    order : (k,) int64
        Places such that parents come before children.
    """

    vessels: IntArray
    parent: IntArray
    order: IntArray


def forest_of(network: VesselNetwork, kind: VesselKind) -> Forest | None:
    """The forest of the vessels of ``kind``; None where they have loops, or there are none."""
    vessels = np.flatnonzero(network.kind == kind)
    ends = network.vessel_nodes[vessels]
    for near, far in ((0, 1), (1, 0)):
        reached = np.bincount(ends[:, far], minlength=len(network.nodes))
        if len(vessels) == 0 or reached.max() > 1:
            continue
        into = np.full(len(network.nodes), -1)
        into[ends[:, far]] = np.arange(len(vessels))
        parent = into[ends[:, near]]
        order = _parents_first(parent)
        if len(order) == len(vessels):
            return Forest(vessels, parent, order)
    return None


@jit
def _parents_first(parent: Any) -> Any:
    """Places that can be reached from the roots, parents before children."""
    size = len(parent)
    eldest = np.full(size, -1)
    sibling = np.full(size, -1)
    for i in range(size - 1, -1, -1):
        if parent[i] >= 0:
            sibling[i] = eldest[parent[i]]
            eldest[parent[i]] = i
    order = np.empty(size, np.int64)
    stack = np.empty(size, np.int64)
    count = 0
    for root in range(size):
        if parent[root] >= 0:
            continue
        stack[0] = root
        top = 1
        while top > 0:
            top -= 1
            i = stack[top]
            order[count] = i
            count += 1
            child = eldest[i]
            while child >= 0:
                stack[top] = child
                top += 1
                child = sibling[child]
    return order[:count]


@jit
def strahler_orders(parent: Any, order: Any) -> Any:
    """Order of each vessel: 1 for terminals; where two of the highest meet, one more.

    Strahler 1957, doi 10.1029/TR038i006p00913.

    Parameters
    ----------
    parent, order : (k,) int64
        As in `Forest`.
    """
    size = len(parent)
    rank = np.ones(size, np.int64)
    highest = np.zeros(size, np.int64)
    shared = np.zeros(size, np.bool_)
    for k in range(size - 1, -1, -1):
        i = order[k]
        if highest[i] > 0:
            rank[i] = highest[i] + (1 if shared[i] else 0)
        p = parent[i]
        if p < 0:
            continue
        if rank[i] > highest[p]:
            highest[p] = rank[i]
            shared[p] = False
        elif rank[i] == highest[p]:
            shared[p] = True
    return rank


@jit
def elements_of(parent: Any, order: Any, rank: Any, diameter: Any) -> Any:
    """Element of each vessel: vessels of one order in series; at a fork the widest goes on.

    Numbers count from 0, parents' before children's.
    """
    size = len(parent)
    heir = np.full(size, -1)
    for k in range(size):
        i = order[k]
        p = parent[i]
        if p < 0 or rank[p] != rank[i]:
            continue
        if heir[p] < 0 or diameter[i] > diameter[heir[p]]:
            heir[p] = i
    element = np.empty(size, np.int64)
    count = 0
    for k in range(size):
        i = order[k]
        if parent[i] >= 0 and heir[parent[i]] == i:
            element[i] = element[parent[i]]
        else:
            element[i] = count
            count += 1
    return element
