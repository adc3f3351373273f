"""Find all pairs of network pieces that come closer than a clearance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.checkers.boxes import box_tree, first_in, meets
from benchmarks.checkers.compiled import compiled
from benchmarks.checkers.distance import segment_segment
from benchmarks.checkers.read_network import Pieces
from benchmarks.checkers.ways import ways_within

ROUNDING_MM = 1e-9


@dataclass(frozen=True)
class Near:
    """Pairs that share no node and come nearer than the clearance.

    Attributes
    ----------
    pairs : (k, 2) int64
        First below second.
    gap : (k,) float64, mm
        Between the walls; negative where they overlap.
    joint : (k,) bool
        Within one joint; the others collide.
    """

    pairs: NDArray[np.int64]
    gap: NDArray[np.float64]
    joint: NDArray[np.bool_]

    @property
    def colliding(self) -> NDArray[np.int64]:
        """Pairs that collide, (c, 2)."""
        return self.pairs[~self.joint]

    @property
    def within_joints(self) -> NDArray[np.int64]:
        """Pairs that overlap within a joint, (j, 2)."""
        return self.pairs[self.joint]


def near_pairs(net: Pieces, clearance_mm: float = 0.0, clearance_ratio: float = 0.0) -> Near:
    """All near pairs of a network.

    The clearance is the larger of ``clearance_mm`` and ``clearance_ratio`` times the thinner
    radius. A pair that is nearer collides when the way between the two along the vessels is longer
    than twice the sum of their radii plus the clearance. A tapered piece counts as wide as its
    wider end. What is nearer by less than a picometre isn't counted: it is rounding.

    Parameters
    ----------
    net : Pieces
    clearance_mm, clearance_ratio : float
    """
    radius = net.widest
    reach = (radius + 0.5 * np.maximum(clearance_mm, clearance_ratio * radius))[:, None]
    low = np.minimum(net.start, net.end) - reach
    high = np.maximum(net.start, net.end) + reach
    tree = box_tree(low, high)
    order = tree.order
    found, gap = _near(
        tree.around,
        tree.levels,
        low[order],
        high[order],
        net.start[order],
        net.end[order],
        radius[order],
        net.node[order],
        clearance_mm,
        clearance_ratio,
    )
    pairs = np.sort(order[found], axis=1)
    by_number = np.lexsort((pairs[:, 1], pairs[:, 0]))
    pairs, gap = pairs[by_number], gap[by_number]
    thinner = radius[pairs].min(axis=1)
    limit = 2.0 * radius[pairs].sum(axis=1)
    limit += np.maximum(clearance_mm, clearance_ratio * thinner)
    return Near(pairs, gap, ways_within(net, pairs, limit))


@compiled
def _near(
    around: Any,
    levels: int,
    low: Any,
    high: Any,
    start: Any,
    end: Any,
    radius: Any,
    node: Any,
    clearance_mm: float,
    clearance_ratio: float,
) -> Any:
    """Walk the box tree for each piece; a pair is found by the earlier of the two."""
    n = len(start)
    pairs, gaps, found = np.empty((1024, 2), np.int64), np.empty(1024), 0
    stack, levels_of = np.empty(128, np.int64), np.empty(128, np.int64)
    for i in range(n):
        stack[0], levels_of[0], depth = 1, 0, 1
        while depth > 0:
            depth -= 1
            k, level = stack[depth], levels_of[depth]
            behind = first_in(k + 1, level, n)
            if behind <= i + 1 or not meets(around, k, low[i], high[i]):
                continue
            if level < levels:
                stack[depth], levels_of[depth] = 2 * k, level + 1
                stack[depth + 1], levels_of[depth + 1] = 2 * k + 1, level + 1
                depth += 2
                continue
            for j in range(max(i + 1, first_in(k, level, n)), behind):
                if (
                    node[i, 0] == node[j, 0]
                    or node[i, 0] == node[j, 1]
                    or node[i, 1] == node[j, 0]
                    or node[i, 1] == node[j, 1]
                ):
                    continue
                gap = segment_segment(start[i], end[i], start[j], end[j]) - radius[i] - radius[j]
                keep = max(clearance_mm, clearance_ratio * min(radius[i], radius[j]))
                if gap >= keep - ROUNDING_MM:
                    continue
                if found == len(gaps):
                    pairs, gaps = _doubled(pairs, gaps)
                pairs[found, 0], pairs[found, 1], gaps[found] = i, j, gap
                found += 1
    return pairs[:found], gaps[:found]


@compiled
def _doubled(pairs: Any, gaps: Any) -> Any:
    n = len(gaps)
    more_pairs, more_gaps = np.empty((2 * n, 2), np.int64), np.empty(2 * n)
    more_pairs[:n], more_gaps[:n] = pairs, gaps
    return more_pairs, more_gaps
