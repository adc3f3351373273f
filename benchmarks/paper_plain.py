"""Plain versions of growth's routines: whole-tree traversals, linked objects, NumPy arrays.

`traversed_cost` is compiled as the product is, so that its time differs by the work alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from heapq import nsmallest
from math import dist
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from design.geometry import point_segment, segment_segment
from design.vasculature import VesselTree
from design.vasculature.treemath import tree_radii

CANDIDATES, STEPS = 10, 7
"""Nearest vessels tried for a bifurcation, as in growth; parts of a triangle's sides, whose 15
inner points are tried."""


@numba.njit(error_model="numpy")
def order_down(children: Any, count: int) -> Any:
    """Return an order of vessels in which parents come before children, (count,)."""
    order, waiting = np.empty(count, np.int64), [0]
    for at in range(count):
        order[at] = waiting.pop()
        for child in children[order[at]]:
            if child >= 0:
                waiting.append(child)
    return order


@numba.njit(error_model="numpy")
def traversed_cost(order: Any, children: Any, length: Any, gamma: float) -> float:
    """Return a tree's cost Σ ℓ r², by one traversal up and one down.

    Up: flows, reduced resistances and ratios (Karch et al. 1999, as in `growth.state`); down:
    radii. 8μ/π, the pressure drop and a terminal's flow are 1. ``order`` is `order_down`'s,
    ``children`` (m, 2) has -1 for none, ``length`` (m,) is in mm; ``gamma`` is Murray's exponent.
    """
    flow, resistance = np.ones(len(length)), length.copy()
    ratio, radius = np.ones(len(length)), np.empty(len(length))
    for i in order[::-1]:
        a, b = children[i]
        if a >= 0:
            x = (flow[a] * resistance[a] / (flow[b] * resistance[b])) ** 0.25
            ratio[a] = (1.0 + x**-gamma) ** (-1.0 / gamma)
            ratio[b] = (1.0 + x**gamma) ** (-1.0 / gamma)
            flow[i] = flow[a] + flow[b]
            resistance[i] += 1.0 / (ratio[a] ** 4 / resistance[a] + ratio[b] ** 4 / resistance[b])
    radius[0] = (flow[0] * resistance[0]) ** 0.25
    cost = 0.0
    for i in order:
        cost += length[i] * radius[i] ** 2
        for child in children[i]:
            if child >= 0:
                radius[child] = radius[i] * ratio[child]
    return cost


@numba.njit
def split(children: Any, count: int, i: int) -> None:
    """Make vessel ``i`` its own upper part, ``count`` the lower and ``count + 1`` the new one."""
    children[count], children[count + 1] = children[i], -1
    children[i] = count, count + 1


@numba.njit
def gap(a: Any, b: Any) -> float:
    """Return the distance of two points, mm, at least a nanometre."""
    return max(1e-6, np.sqrt(((a - b) ** 2).sum()))


@numba.njit(error_model="numpy")
def cost_at(tree: Any, parts: Any, ends: Any, place: Any, gamma: float) -> float:
    """Return a tree's cost (order, children, length) if ``parts`` lead from a place to ends."""
    for n in range(3):
        tree[2][parts[n]] = gap(place, ends[n])
    return traversed_cost(tree[0], tree[1], tree[2], gamma)


@numba.njit(error_model="numpy")
def best_of_15(children: Any, length: Any, count: int, i: int, ends: Any, gamma: float) -> Any:
    """Return the least cost and its place for a new vessel on ``i``; leave the tree as it was."""
    split(children, count, i)
    tree, before = (order_down(children, count + 2), children, length), length[i]
    best, where = np.inf, ends[0]
    for a in range(1, STEPS - 1):
        for b in range(1, STEPS - a):
            place = (a * ends[0] + b * ends[1] + (STEPS - a - b) * ends[2]) / STEPS
            cost = cost_at(tree, (i, count, count + 1), ends, place, gamma)
            if cost < best:
                best, where = cost, place
    children[i], length[i] = children[count], before
    return best, where


@numba.njit(error_model="numpy")
def grow_by_traversals(points: Any, gamma: float) -> None:
    """Grow from ``points[0]`` to all others (Schreiner & Buxbaum 1993), blind to collisions."""
    n, count = 2 * len(points) - 3, 1
    near, far, length = np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
    children = np.full((n, 2), -1)
    near[0], far[0], length[0] = points[0], points[1], gap(points[0], points[1])
    for t in points[2:]:
        away = np.empty(count)
        for i in range(count):
            p, d = near[i], far[i]
            away[i] = point_segment(t[0], t[1], t[2], p[0], p[1], p[2], d[0], d[1], d[2])[0]
        best, at, chosen = np.inf, t, 0
        for i in np.argsort(away)[:CANDIDATES]:
            ends = np.stack((near[i], far[i], t))
            cost, place = best_of_15(children, length, count, i, ends, gamma)
            if cost < best:
                best, at, chosen = cost, place, i
        split(children, count, chosen)
        near[count], far[count] = at, far[chosen]
        near[count + 1], far[count + 1], far[chosen] = at, t, at
        for i in (chosen, count, count + 1):
            length[i] = gap(near[i], far[i])
        count += 2


class Vessel:
    """A vessel as a linked object of plain floats, with its bounding ball; mm."""

    __slots__ = ("ball", "children", "distal", "middle", "proximal", "radius", "ratio")

    def __init__(self, proximal: Any, distal: Any, radius: float, ratio: float = 1.0) -> None:
        self.proximal, self.distal, self.radius, self.ratio = proximal, distal, radius, ratio
        self.middle = [(a + b) / 2 for a, b in zip(proximal, distal, strict=True)]
        self.ball = dist(proximal, distal) / 2 + radius
        self.children: list[Vessel] = []


def linked(tree: VesselTree) -> list[Vessel]:
    """Return a tree's vessels as linked objects, the root first."""
    columns = (tree.proximal, tree.distal, tree_radii(tree), tree.ratio)
    vessels = [Vessel(*one) for one in zip(*(x.tolist() for x in columns), strict=True)]
    for vessel, pair in zip(vessels, tree.children, strict=True):
        vessel.children = [vessels[c] for c in pair if c >= 0]
    return vessels


def walk(root: Vessel) -> Iterator[Vessel]:
    """Visit all vessels, parents first."""
    waiting = [root]
    while waiting:
        vessel = waiting.pop()
        yield vessel
        waiting += vessel.children


def linked_nearest(root: Vessel, point: Any) -> list[Vessel]:
    """Return the ten vessels nearest to a point by their axes."""
    away = point_segment.py_func
    return nsmallest(CANDIDATES, walk(root), lambda x: away(*point, *x.proximal, *x.distal)[0])


def linked_rescale(root: Vessel, radius: float) -> None:
    """Set the root's radius, mm, and all others' by their ratios."""
    root.radius = radius
    for vessel in walk(root):
        for child in vessel.children:
            child.radius = vessel.radius * child.ratio


def meets(vessels: Iterable[Vessel], new: Vessel, leaves: Vessel) -> bool:
    """Whether a new vessel meets any but the one it leaves; bounding balls first."""
    for one in vessels:
        if dist(one.middle, new.middle) <= one.ball + new.ball and one is not leaves:
            ends = (*one.proximal, *one.distal, *new.proximal, *new.distal)
            if segment_segment.py_func(*ends)[0] < one.radius + new.radius:
                return True
    return False


def array_nearest(tree: VesselTree, point: NDArray[np.float64]) -> Any:
    """Return the ten vessels nearest to a point, by NumPy."""
    along, to = tree.distal - tree.proximal, point - tree.proximal
    part = (to * along).sum(axis=1) / (along * along).sum(axis=1)
    to -= np.clip(part, 0.0, 1.0)[:, None] * along
    return np.argpartition((to * to).sum(axis=1), CANDIDATES)[:CANDIDATES]


def balls_meet(tree: VesselTree, radius: Any, new: Vessel) -> NDArray[np.int64]:
    """Return the vessels whose bounding balls meet a new one's, by NumPy."""
    reach = np.linalg.norm(tree.distal - tree.proximal, axis=1) / 2 + radius + new.ball
    away = np.linalg.norm((tree.proximal + tree.distal) / 2 - new.middle, axis=1)
    return np.flatnonzero(away <= reach)
