"""Nodes of a graph with loops eliminated, those with fewest vessels first, without cancellation.

A node v of admittances w_i to its neighbours and G to ground, with Σ = G + Σ w_i, goes away by the
star-mesh transform (Rosen 1924): neighbours i and j gain w_i w_j/Σ between them, and w_i G/Σ to
ground. It is Gaussian elimination, but of admittances and not of matrix entries: where these are
positive all is sums and products of positive numbers, and nothing cancels (as in Grassmann, Taksar
& Heyman 1985 for Markov chains), however far they lie apart.

A node of `MOST` neighbours adds up to MOST (MOST - 3)/2 links. What is left by then is small and
dense, and better done by a general sparse solver: of an artery and a vein joined at 200,000
terminals (800,000 unknowns in loops) 50,000.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.network import IntArray
from kernels import jit

Numbers = NDArray[Any]
Small = NDArray[np.int32]

MOST: Final = 16
"""Neighbours of a node above which it isn't eliminated here."""


@dataclass(frozen=True)
class StarMesh:
    """In which order nodes go, and what each step adds to what.

    Attributes
    ----------
    order : (k,) int32
        Eliminated nodes.
    begin : (k + 1,) int64
        Node ``order[i]`` has neighbours ``neighbour[begin[i]:begin[i + 1]]`` when it goes.
    neighbour, link : (c,) int32
        And the links to them.
    pair : (p,) int32
        Of each step in turn, the link between each two of its neighbours, of (1, 0), (2, 0),
        (2, 1), (3, 0), …
    links : (l, 2) int32
        Ends of links; those given come first.
    of_given : (g,) int32
        Link that each given one counts to: parallel ones become one.
    left : (r,) int64
        Nodes that are left, ``left_links`` (s,) the links between them, ``left_ends`` (s, 2) these
        links' ends, numbered in ``left``.
    """

    order: Small
    begin: IntArray
    neighbour: Small
    link: Small
    pair: Small
    links: Small
    of_given: Small
    left: IntArray
    left_links: IntArray
    left_ends: IntArray


def star_mesh_of(first: IntArray, last: IntArray, count: int) -> StarMesh:
    """Order the elimination of nodes 0 to ``count`` - 1, linked from ``first`` to ``last``."""
    found = _plan(first.astype(np.int32), last.astype(np.int32), count, MOST)
    order, begin, neighbour, link, pair, links, of_given = found
    stays = np.ones(count, dtype=bool)
    stays[order] = False
    left = np.flatnonzero(stays)
    used = np.zeros(len(links), dtype=bool)
    used[of_given] = True
    used[len(first) :] = True
    left_links = np.flatnonzero(used & stays[links[:, 0]] & stays[links[:, 1]])
    number = np.cumsum(stays) - 1
    return StarMesh(
        order,
        begin,
        neighbour,
        link,
        pair,
        links,
        of_given,
        left,
        left_links,
        number[links[left_links]],
    )


@jit
def _longer(old: Small, least: int) -> Small:
    new = np.empty(max(2 * len(old), least), np.int32)
    new[: len(old)] = old
    return new


@jit
def _degrees(first: Small, last: Small, count: int) -> IntArray:
    """Room for each node's neighbours: as many as links, and a few more."""
    start = np.zeros(count + 1, np.int64)
    for k in range(len(first)):
        start[first[k] + 1] += 1
        start[last[k] + 1] += 1
    for v in range(count):
        start[v + 1] += start[v] + 3
    return start


@jit
def _plan(
    first: Small, last: Small, count: int, most: int
) -> tuple[Small, IntArray, Small, Small, Small, Small, Small]:
    """The whole elimination on paper.

    One long kernel: its state is a dozen arrays, several of which grow. Neighbours stand in
    ``pool`` from ``start[v]`` on, ``used[v]`` of them, those already gone included; a list that is
    full is cleared of these, or moves to the end of the pool. Nodes wait on a stack for each
    degree; what a node's degree was when it was put there may be out of date.
    """
    given = len(first)
    places = _degrees(first, last, count)
    start, room = places[:count].copy(), np.empty(count, np.int32)
    for v in range(count):
        room[v] = places[v + 1] - places[v]
    end = places[count]
    pool, by = np.empty(2 * end + 64, np.int32), np.empty(2 * end + 64, np.int32)
    used, degree = np.zeros(count, np.int32), np.zeros(count, np.int32)
    ends, of_given = np.empty(4 * given + 64, np.int32), np.empty(given, np.int32)
    for k in range(given):
        a, b = first[k], last[k]
        ends[2 * k], ends[2 * k + 1], of_given[k] = a, b, k
        short, other = (a, b) if used[a] < used[b] else (b, a)
        for at in range(start[short], start[short] + used[short]):
            if pool[at] == other:
                of_given[k] = by[at]
        if of_given[k] == k:
            pool[start[a] + used[a]], by[start[a] + used[a]] = b, k
            pool[start[b] + used[b]], by[start[b] + used[b]] = a, k
            used[a] += 1
            used[b] += 1
    degree[:] = used
    top, below = np.full(most + 1, -1, np.int32), np.full(count, -1, np.int32)
    above, stands = np.full(count, -1, np.int32), np.full(count, -1, np.int32)
    for v in range(count - 1, -1, -1):
        d = degree[v]
        if d <= most:
            below[v], stands[v] = top[d], d
            if top[d] >= 0:
                above[top[d]] = v
            top[d] = v
    gone = np.zeros(count, np.bool_)
    order, begin, steps = np.empty(count, np.int32), np.zeros(count + 1, np.int64), 0
    neighbour, link, entries = np.empty(4 * count, np.int32), np.empty(4 * count, np.int32), 0
    pair, pairs = np.empty(6 * count, np.int32), 0
    links, least = given, 0
    while True:
        while least <= most and top[least] < 0:
            least += 1
        if least > most:
            break
        v = top[least]
        top[least], gone[v] = below[v], True
        if below[v] >= 0:
            above[below[v]] = -1
        if entries + most > len(neighbour):
            neighbour, link = _longer(neighbour, 0), _longer(link, 0)
        if pairs + most * most > len(pair):
            pair = _longer(pair, pairs + most * most)
        low = entries
        for at in range(start[v], start[v] + used[v]):
            if not gone[pool[at]]:
                neighbour[entries], link[entries] = pool[at], by[at]
                degree[pool[at]] -= 1
                entries += 1
        order[steps] = v
        steps += 1
        begin[steps] = entries
        for i in range(low, entries):
            a = neighbour[i]
            for j in range(low, i):
                b, between = neighbour[j], -1
                short, other = (a, b) if used[a] <= used[b] else (b, a)
                for at in range(start[short], start[short] + used[short]):
                    if pool[at] == other:
                        between = by[at]
                        break
                if between < 0:
                    between = links
                    links += 1
                    if 2 * links > len(ends):
                        ends = _longer(ends, 0)
                    ends[2 * between], ends[2 * between + 1] = a, b
                    for node, other in ((a, b), (b, a)):
                        degree[node] += 1
                        if used[node] == room[node]:
                            kept, old = 0, start[node]
                            for at in range(old, old + used[node]):
                                if not gone[pool[at]]:
                                    pool[old + kept], by[old + kept] = pool[at], by[at]
                                    kept += 1
                            used[node] = kept
                            if 2 * kept > room[node]:
                                room[node] *= 2
                                if end + room[node] > len(pool):
                                    pool = _longer(pool, end + room[node])
                                    by = _longer(by, end + room[node])
                                for at in range(kept):
                                    pool[end + at], by[end + at] = pool[old + at], by[old + at]
                                start[node] = end
                                end += room[node]
                        pool[start[node] + used[node]] = other
                        by[start[node] + used[node]] = between
                        used[node] += 1
                pair[pairs] = between
                pairs += 1
        for i in range(low, entries):
            a = neighbour[i]
            old, d = stands[a], degree[a]
            if old == d:
                continue
            if old >= 0:
                if above[a] >= 0:
                    below[above[a]] = below[a]
                else:
                    top[old] = below[a]
                if below[a] >= 0:
                    above[below[a]] = above[a]
                stands[a] = -1
            if d <= most:
                above[a], below[a], stands[a] = -1, top[d], d
                if top[d] >= 0:
                    above[top[d]] = a
                top[d] = a
                least = min(least, d)
    return (
        order[:steps].copy(),
        begin[: steps + 1].copy(),
        neighbour[:entries].copy(),
        link[:entries].copy(),
        pair[:pairs].copy(),
        ends[: 2 * links].copy().reshape((links, 2)),
        of_given,
    )


@jit
def fold_stars(
    order: Small,
    begin: IntArray,
    neighbour: Small,
    link: Small,
    pair: Small,
    weight: Numbers,
    ground: Numbers,
) -> tuple[Numbers, Numbers]:
    """Shares w_i/Σ of each step's neighbours (c,) and its Σ (k,).

    ``weight`` (l,) of links and ``ground`` (n,) gain what is folded onto them, in place.
    """
    share, total = np.empty(len(neighbour), weight.dtype), np.empty(len(order), weight.dtype)
    p = 0
    for k in range(len(order)):
        here = ground[order[k]]
        low, high = begin[k], begin[k + 1]
        whole = here
        for i in range(low, high):
            whole += weight[link[i]]
        total[k] = whole
        for i in range(low, high):
            w = weight[link[i]]
            share[i] = w / whole
            ground[neighbour[i]] += share[i] * here
            for j in range(low, i):
                weight[pair[p]] += w * share[j]
                p += 1
    return share, total


@jit
def gather_stars(
    order: Small, begin: IntArray, neighbour: Small, share: Numbers, source: Numbers
) -> None:
    """Carry sources (n,) of eliminated nodes to their neighbours, in place."""
    for k in range(len(order)):
        here = source[order[k]]
        for i in range(begin[k], begin[k + 1]):
            source[neighbour[i]] += share[i] * here


@jit
def unfold_stars(
    order: Small,
    begin: IntArray,
    neighbour: Small,
    share: Numbers,
    total: Numbers,
    source: Numbers,
    value: Numbers,
) -> None:
    """Values (n,) of eliminated nodes from their neighbours', last to first, in place."""
    for k in range(len(order) - 1, -1, -1):
        here = source[order[k]] / total[k]
        for i in range(begin[k], begin[k + 1]):
            here += share[i] * value[neighbour[i]]
        value[order[k]] = here
