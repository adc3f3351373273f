"""Oracle of a bifurcation's optimum: costs of the whole tree, by traversals.

Accuracy is the part of what can be gained over the vessel's middle that the chosen place gains.
Costs are `traversed_cost` of the whole tree, the optimum is Nelder and Mead's of it: neither
shares code with growth.
"""

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from design.vasculature import VesselTree, tree_radii
from design.vasculature.growth.kernels.bifurcation import NewTerminal
from design.vasculature.growth.kernels.cost import SEGMENT, refresh_all, spread_down
from design.vasculature.growth.kernels.proposals import estimate
from design.vasculature.options import Law
from design.vasculature.penalty import no_penalty

STEPS = 7
"""Parts of a triangle's sides, whose 15 inner points are tried."""


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

    Up: flows, reduced resistances and ratios (Karch et al. 1999, as in `growth.cost`); down:
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


FloatArray = NDArray[np.float64]

LEVELS = 3  # depths drawn as one


class Case:
    """A new terminal at ``end`` (3,), mm, for vessel ``i`` of a grown tree, and its optimum."""

    def __init__(self, tree: VesselTree, i: int, end: FloatArray) -> None:
        n, self.i, self.gamma = len(tree.parent), i, tree.murray_exponent
        self.ends = np.stack([tree.proximal[i], tree.distal[i], end])
        length = np.append(np.linalg.norm(tree.distal - tree.proximal, axis=1), [0.0, 0.0])
        children = np.concatenate([tree.children, np.full((2, 2), -1)]).astype(np.int64)
        start = best_of_15(children, length, n, i, self.ends, self.gamma)[1] - self.ends[0]
        split(children, n, i)
        self.tree, self.parts = (order_down(children, n + 2), children, length), (i, n, n + 1)
        self.middle = self.cost(self.ends[:2].mean(axis=0))
        plane = np.linalg.lstsq((self.ends[1:] - self.ends[0]).T, start)[0]
        fine = {"xatol": 1e-6, "fatol": 1e-14 * self.middle, "maxiter": 300}
        best = minimize(lambda x: self.cost(self.at(x)), plane, method="Nelder-Mead", options=fine)
        self.best = float(best.fun)

    def at(self, plane: Any) -> FloatArray:
        """Return the point (3,), mm, at two coordinates in the plane of the three ends."""
        return np.asarray(self.ends[0] + np.asarray(plane) @ (self.ends[1:] - self.ends[0]))

    def cost(self, place: FloatArray) -> float:
        """Return the whole tree's cost with the bifurcation at ``place`` (3,), mm."""
        return float(cost_at(self.tree, self.parts, self.ends, place, self.gamma))


def law_of(tree: VesselTree, length_exponent: float = 1.0, radius_exponent: float = 2.0) -> Law:
    """The constants of the cost Σ ℓᵘ r^λ for a tree."""
    k = 8.0 * tree.viscosity_pa_s / np.pi
    return Law(k, tree.murray_exponent, radius_exponent, length_exponent, tree.haematocrit)


def segments_of(tree: VesselTree, law: Law) -> Any:
    """The tree as growing segments, with radii and derivatives of the cost."""
    segments = np.zeros(len(tree.parent), SEGMENT)
    for axis, name in enumerate("xyz"):
        segments[f"p{name}"] = tree.proximal[:, axis]
        segments[f"d{name}"] = tree.distal[:, axis]
    segments["length"] = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    segments["parent"] = tree.parent
    segments["left"], segments["right"] = tree.children.T
    segments["allowed"] = np.inf
    segments["flow"], segments["relative_viscosity"] = tree.relative_flow, tree.relative_viscosity
    segments["given"] = tree.given
    refresh_all(segments, len(segments), law)
    spread_down(segments, len(segments), float(tree_radii(tree)[0]), 1.0, law)
    return segments


def cases_of(tree: VesselTree, each: int) -> tuple[list[Case], NDArray[np.int64]]:
    """Draw at most ``each`` cases per `LEVELS` depths with something to gain; and their depths."""
    depth = np.zeros(len(tree.parent), np.int64)
    for i in order_down(tree.children.astype(np.int64), len(depth))[1:]:
        depth[i] = depth[tree.parent[i]] + 1
    rng, cases = np.random.default_rng(1), []
    for low in range(1, int(depth.max()) + 1, LEVELS):
        there = np.flatnonzero((depth >= low) & (depth < low + LEVELS))
        for i in rng.permutation(there)[:each].tolist():
            length = np.linalg.norm(tree.distal[i] - tree.proximal[i])
            end = (tree.proximal[i] + tree.distal[i]) / 2 + rng.normal(0, length, 3)
            cases.append(Case(tree, i, end))
    cases = [one for one in cases if one.middle > one.best * (1 + 1e-6 / len(depth))]
    return cases, depth[[one.i for one in cases]]


@numba.njit
def by_growth(segments: Any, chosen: Any, ends: Any, one: Any, law: Any, free: Any) -> Any:
    """Return the places that growth chooses, (n, 3), mm."""
    found, slopes = np.empty((len(chosen), 3)), np.empty(3)
    for n in range(len(chosen)):
        estimate(segments, chosen[n], ends[n, 2], one, free, found[n], slopes, law)
    return found


def accuracies(tree: VesselTree, cases: list[Case]) -> FloatArray:
    """Return the part of what can be gained that growth's choice gains, %, of each case."""
    law, one = law_of(tree), NewTerminal(1.0, 1.0)
    chosen, ends = np.array([c.i for c in cases]), np.stack([c.ends for c in cases])
    places = by_growth(segments_of(tree, law), chosen, ends, one, law, no_penalty())
    costs = np.array(list(map(Case.cost, cases, places)))
    middle, best = np.array([(case.middle, case.best) for case in cases]).T
    return np.asarray(100 * (middle - costs) / (middle - best))
