"""Eliminate a looped graph's nodes of at most two neighbours: chains become single links.

A node of admittances w_a and w_b to its neighbours and G to ground, Σ = G + w_a + w_b, goes away
by the star-mesh transform (Rosen 1924): its neighbours gain w_a w_b/Σ between them, and w_i G/Σ
each to ground; a source s on it counts as s w_i/Σ on each. No node gains a neighbour, so that
this takes linear time; a positive graph's numbers are sums and products of positive ones, and
nothing cancels. Where a link's two ends are joined already the two become one, and more nodes may
follow.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kernels import jit
from kernels.arrays import IntArray

Numbers = NDArray[Any]
"""Real or complex."""


class Chains(NamedTuple):
    """Which nodes go in which order, and onto which links; l links are given.

    Attributes
    ----------
    order : (k,) int64
        Eliminated nodes.
    neighbour, link : (k, 2) int64
        Their neighbours then, and the links to these; where there are fewer than two, the node
        itself by link l, which has no admittance.
    onto : (k,) int64
        Link between the neighbours: another one, or the second of the two taken on; l + 1 where
        there is none.
    left : (r,) int64
        Nodes that are left.
    left_links, left_ends : (s,), (s, 2) int64
        Links between them, and their ends by number in ``left``; parallel ones are allowed.
    """

    order: IntArray
    neighbour: IntArray
    link: IntArray
    onto: IntArray
    left: IntArray
    left_links: IntArray
    left_ends: IntArray


def chains_of(first: IntArray, last: IntArray, count: int) -> Chains:
    """Plan for nodes 0 to ``count`` - 1, linked from ``first`` to ``last``, no node to itself."""
    ends = np.column_stack([first, last])
    order, neighbour, link, onto, alive, gone = _plan(ends, count)
    number = np.cumsum(~gone) - 1
    links = np.flatnonzero(alive)
    return Chains(
        order, neighbour, link, onto, np.flatnonzero(~gone), links, number[ends[links]]
    )  # fmt: skip


@jit
def _link_lists(ends: IntArray, count: int) -> tuple[IntArray, IntArray, IntArray]:
    """Links of each node: where its list begins, (n + 1,), all lists, and their lengths."""
    degree = np.zeros(count, np.int64)
    for k in range(len(ends)):
        degree[ends[k, 0]] += 1
        degree[ends[k, 1]] += 1
    start = np.zeros(count + 1, np.int64)
    start[1:] = np.cumsum(degree)
    lists, free = np.empty(start[count], np.int64), start[:count].copy()
    for k in range(len(ends)):
        for side in range(2):
            node = ends[k, side]
            lists[free[node]] = k
            free[node] += 1
    return start, lists, degree


@jit
def _plan(
    ends: IntArray, count: int
) -> tuple[IntArray, IntArray, IntArray, IntArray, NDArray[np.bool_], NDArray[np.bool_]]:
    """`Chains`' first four, links and nodes that are left; ``ends`` (l, 2) changes in place.

    One kernel: its arrays, handed on, would cost as much as its work.
    """
    links = len(ends)
    start, lists, degree = _link_lists(ends, count)
    alive, gone = np.ones(links, np.bool_), np.zeros(count, np.bool_)
    order, onto = np.empty(count, np.int64), np.empty(count, np.int64)
    neighbour, link = np.empty((count, 2), np.int64), np.empty((count, 2), np.int64)
    steps = 0
    # Each elimination takes one node off and puts at most two on.
    stack = np.empty(count + 2, np.int64)
    for seed in range(count):
        stack[0], waiting = seed, 1
        while waiting:
            waiting -= 1
            node = stack[waiting]
            if gone[node] or degree[node] > 2:
                continue
            gone[node] = True
            near, via = neighbour[steps], link[steps]
            near[:], via[:] = node, links
            found = 0
            for at in range(start[node], start[node + 1]):
                k = lists[at]
                if alive[k]:
                    near[found], via[found] = ends[k, 0] + ends[k, 1] - node, k
                    found += 1
            target = links + 1
            if found == 2 and near[0] != near[1]:
                # The shorter list is searched.
                if start[near[0] + 1] - start[near[0]] > start[near[1] + 1] - start[near[1]]:
                    near[0], near[1] = near[1], near[0]
                    via[0], via[1] = via[1], via[0]
                place = -1
                for at in range(start[near[0]], start[near[0] + 1]):
                    k = lists[at]
                    if k == via[0]:
                        place = at
                    elif alive[k] and ends[k, 0] + ends[k, 1] - near[0] == near[1]:
                        target = k
                if target > links:
                    target = via[1]
                    lists[place] = target
                    ends[target, 0], ends[target, 1] = near[0], near[1]
            for i in range(found):
                if via[i] != target:
                    alive[via[i]] = False
                if target != via[1]:
                    degree[near[i]] -= 1
                    if degree[near[i]] <= 2:
                        stack[waiting] = near[i]
                        waiting += 1
            order[steps], onto[steps] = node, target
            steps += 1
    return (
        order[:steps].copy(),
        neighbour[:steps].copy(),
        link[:steps].copy(),
        onto[:steps].copy(),
        alive,
        gone,
    )


@jit
def fold_chains(plan: Chains, weight: Numbers, ground: Numbers) -> tuple[Numbers, Numbers]:
    """Shares w_i/Σ (k, 2) of each node's neighbours and its Σ (k,).

    ``weight`` (l + 2,) of links and ``ground`` (n,) gain what is folded onto them, in place.
    """
    order, neighbour, link, onto = plan.order, plan.neighbour, plan.link, plan.onto
    share, total = np.empty((len(order), 2), weight.dtype), np.empty(len(order), weight.dtype)
    for k in range(len(order)):
        here = ground[order[k]]
        a, b = weight[link[k, 0]], weight[link[k, 1]]
        total[k] = here + a + b
        share[k, 0], share[k, 1] = a / total[k], b / total[k]
        ground[neighbour[k, 0]] += share[k, 0] * here
        ground[neighbour[k, 1]] += share[k, 1] * here
        weight[link[k, 1]] = 0.0
        weight[onto[k]] += a * share[k, 1]
    return share, total


@jit
def gather_chains(plan: Chains, share: Numbers, source: Numbers) -> None:
    """Carry sources (n,) of eliminated nodes to their neighbours, in place."""
    order, neighbour = plan.order, plan.neighbour
    for k in range(len(order)):
        here = source[order[k]]
        source[neighbour[k, 0]] += share[k, 0] * here
        source[neighbour[k, 1]] += share[k, 1] * here


@jit
def unfold_chains(
    plan: Chains, share: Numbers, total: Numbers, source: Numbers, value: Numbers
) -> None:
    """Values (n,) of eliminated nodes from their neighbours', last to first, in place."""
    order, neighbour = plan.order, plan.neighbour
    for k in range(len(order) - 1, -1, -1):
        here = source[order[k]] / total[k]
        for i in range(2):
            if neighbour[k, i] != order[k]:
                here += share[k, i] * value[neighbour[k, i]]
        value[order[k]] = here
