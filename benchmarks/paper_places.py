"""Accuracy and time of a bifurcation's optimum, by printctl and others: figures 2C and S3.

Accuracy is the part of what can be gained over the vessel's middle that the chosen place gains.
Costs are `traversed_cost` of the whole tree, the optimum is Nelder and Mead's of it: neither
shares code with growth. Growth has no seam for an optimiser (its own is compiled into `estimate`),
so that others are compared here alone.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.command import Row
from benchmarks.machine import row
from benchmarks.paper_plain import best_of_15, cost_at, gap, order_down, split
from design.vasculature import VesselTree
from design.vasculature.growth.fit import split_value
from design.vasculature.growth.propose import estimate
from design.vasculature.growth.state import SEGMENT, Sprout, climb, refresh_all, spread_down
from design.vasculature.options import Law
from design.vasculature.penalty import no_penalty
from design.vasculature.treemath import tree_radii

FloatArray = NDArray[np.float64]

PAPER = "the paper (arXiv 2308.07586)"
BANDS = ((1, 5, 60), (6, 11, 60), (12, 20, 60), (21, 999, 95))
"""Depths and the paper's least median, %: 60 at all, 95 deep, which begins beyond 20 there."""

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
    segments["flow"], segments["thick"] = tree.relative_flow, tree.relative_viscosity
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
def bound_cost(segments: Any, i: int, ends: Any, u: float, v: float, one: Any, law: Any) -> float:
    """Return the exact rise of the cost by growth's partial binding, at a point of the plane."""
    place = ends[0] + u * (ends[1] - ends[0]) + v * (ends[2] - ends[0])
    up, low, new = gap(place, ends[0]), gap(place, ends[1]), gap(place, ends[2])
    parted = split_value(segments[i], up, low, new, one, law)
    return climb(segments, i, parted[0], parted[1], one.flow, 10**9, law)[0]


@numba.njit
def by_grid(segments: Any, chosen: Any, ends: Any, one: Any, law: Any) -> Any:
    """Return the best of 78 points of each case's plane, (n, 2)."""
    found = np.empty((len(chosen), 2))
    for n in range(len(chosen)):
        best = np.inf
        for a in range(12):
            for b in range(12 - a):
                u, v = (a + 1 / 3) / 12, (b + 1 / 3) / 12
                cost = bound_cost(segments, chosen[n], ends[n], u, v, one, law)
                if cost < best:
                    best = cost
                    found[n] = u, v
    return found


@numba.njit
def by_growth(segments: Any, chosen: Any, ends: Any, one: Any, law: Any, free: Any) -> Any:
    """Return the places that growth chooses, (n, 3), mm."""
    found, slopes = np.empty((len(chosen), 3)), np.empty(3)
    for n in range(len(chosen)):
        estimate(segments, chosen[n], ends[n, 2], one, free, found[n], slopes, law)
    return found


def compare(tree: VesselTree, cases: list[Case]) -> Iterator[tuple[str, FloatArray, float]]:
    """Yield each optimiser's name, accuracies (%) and CPU time of a case (µs)."""
    law, one, free = law_of(tree), Sprout(1.0, 1.0), no_penalty()
    segments = segments_of(tree, law)
    chosen, ends = np.array([c.i for c in cases]), np.stack([c.ends for c in cases])

    def simplex(case: Case) -> Any:
        def cost(x: Any) -> Any:
            return bound_cost(segments, case.i, case.ends, x[0], x[1], one, law)

        return minimize(cost, (1 / 3, 1 / 3), method="Nelder-Mead").x

    for name, task in (
        ("printctl", lambda: by_growth(segments, chosen, ends, one, law, free)),
        ("grid of 78 places", lambda: by_grid(segments, chosen, ends, one, law)),
        ("Nelder–Mead (SciPy)", lambda: np.array(list(map(simplex, cases)))),
    ):
        task()
        begin = time.process_time()
        found = task()
        took = (time.process_time() - begin) / len(cases) * 1e6
        places = found if found.shape[1] == 3 else map(Case.at, cases, found)
        costs = np.array(list(map(Case.cost, cases, places)))
        middle, best = np.array([(case.middle, case.best) for case in cases]).T
        yield name, 100 * (middle - costs) / (middle - best), took


def accuracy_panels(by_depth: Any, by_time: Any, tree: VesselTree, quick: bool) -> Iterator[Row]:
    """2C and S3: rows, and both drawn."""
    cases, depth = cases_of(tree, 12 if quick else 40)
    for name, accuracy, took in compare(tree, cases):
        low, middle, high = np.percentile(accuracy, [10, 50, 90])
        spread = [[middle - low], [high - middle]]
        by_time.errorbar(took, middle, spread, fmt="o", capsize=3, label=name)
        found = row(f"panel S3: {name}, one bifurcation", round(took, 2), "CPU µs")
        yield found | {"accuracy_median": middle, "accuracy_10th_percentile": low}
        if name == "printctl":
            ours = accuracy
    by_time.set(xscale="log", xlabel="one bifurcation (CPU µs)")
    by_time.set(ylabel="accuracy (%): median, 10th to 90th percentile")
    by_time.set(title="S3: optimisers", ylim=(0, 103), xlim=(0.5, 5e3))
    for first, last, least in BANDS:
        there = (depth >= first) & (depth <= last)
        value = float(np.median(ours[there]))
        name = f"panel 2C: median accuracy, depths {first} to {min(last, depth.max())}"
        told = {"name": f"{PAPER}, figure 2C", "value": f">= {least}"}
        found = row(name, round(value, 1), "%", f">= {least}", value >= least, told)
        yield found | {"cases": int(there.sum())}
    level = (depth - 1) // LEVELS
    groups = [np.percentile(ours[level == one], [0, 50, 100]) for one in np.unique(level)]
    x, (low, middle, high) = LEVELS * np.unique(level) + 2, np.transpose(groups)
    by_depth.fill_between(x, low, high, color="C0", alpha=0.15, lw=0, label="worst to best")
    by_depth.plot(x, middle, "o-", ms=3, color="C0", label="printctl, median")
    for value, where in ((60, "at all depths"), (95, "deep")):
        by_depth.axhline(value, color="0.3", ls="--", lw=1)
        by_depth.text(x[-1], value - 1, f"paper, {where}: ≥ {value} %", ha="right", va="top")
    by_depth.set(xlabel="depth of the bifurcation", ylabel="accuracy (%)", ylim=(0, 103))
    by_depth.set(title="2C: accuracy of a bifurcation")
