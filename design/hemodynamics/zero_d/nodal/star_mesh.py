"""Plan the star-mesh elimination order of a looped graph's nodes, fewest neighbours first.

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
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kernels import jit
from kernels.arrays import IntArray

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
    plan = _plan(first.astype(np.int32), last.astype(np.int32), count, MOST)
    order, begin, neighbour, link, pair, links, of_given = plan
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


class _Queue(NamedTuple):
    """Nodes that wait, by degree: a doubly linked stack for each degree up to the most.

    Attributes
    ----------
    top : (most + 1,) int32
        First node of each degree; -1 for none.
    below, above : (n,) int32
        Each node's neighbours on its stack.
    stands : (n,) int32
        Degree of the stack that it is on; -1 off all.
    """

    top: Small
    below: Small
    above: Small
    stands: Small


class _Lists(NamedTuple):
    """Nodes' neighbours, those already eliminated among them.

    Attributes
    ----------
    start, room, used : (n,)
        Where a node's list begins, how many it has room for, and how many there are.
    degree : (n,) int32
        Neighbours that aren't eliminated.
    gone : (n,) bool
        Eliminated nodes.
    end : (1,) int64
        Where the pool's unused part begins.
    """

    start: IntArray
    room: Small
    used: Small
    degree: Small
    gone: NDArray[np.bool_]
    end: IntArray


@jit
def _longer(old: Small, least: int) -> Small:
    new = np.empty(max(2 * len(old), least), np.int32)
    new[: len(old)] = old
    return new


@jit
def _empty_lists(first: Small, last: Small, count: int) -> _Lists:
    """Room for each node's neighbours: as many as links, and a few more."""
    room = np.full(count, 3, np.int32)
    for k in range(len(first)):
        room[first[k]] += 1
        room[last[k]] += 1
    start, end = np.empty(count, np.int64), np.zeros(1, np.int64)
    for v in range(count):
        start[v] = end[0]
        end[0] += room[v]
    return _Lists(
        start,
        room,
        np.zeros(count, np.int32),
        np.zeros(count, np.int32),
        np.zeros(count, np.bool_),
        end,
    )


@jit
def _between(lists: _Lists, pool: Small, by: Small, a: int, b: int) -> int:
    """Link between two nodes; -1 for none."""
    short, other = (a, b) if lists.used[a] <= lists.used[b] else (b, a)
    begin = lists.start[short]
    for at in range(begin, begin + lists.used[short]):
        if pool[at] == other:
            return int(by[at])
    return -1


@jit
def _add(lists: _Lists, pool: Small, by: Small, node: int, other: int, link: int) -> None:
    """Put a neighbour at the end of a node's list, which has room."""
    at = lists.start[node] + lists.used[node]
    pool[at], by[at] = other, link
    lists.used[node] += 1
    lists.degree[node] += 1


@jit
def _make_room(lists: _Lists, pool: Small, by: Small, node: int) -> tuple[Small, Small]:
    """Clear a full list of eliminated nodes; one that stays over half full moves to the end."""
    kept, old = 0, lists.start[node]
    for at in range(old, old + lists.used[node]):
        if not lists.gone[pool[at]]:
            pool[old + kept], by[old + kept] = pool[at], by[at]
            kept += 1
    lists.used[node] = kept
    if 2 * kept > lists.room[node]:
        lists.room[node] *= 2
        begin = lists.end[0]
        lists.end[0] += lists.room[node]
        if lists.end[0] > len(pool):
            pool, by = _longer(pool, lists.end[0]), _longer(by, lists.end[0])
        for at in range(kept):
            pool[begin + at], by[begin + at] = pool[old + at], by[old + at]
        lists.start[node] = begin
    return pool, by


@jit
def _push(queue: _Queue, v: int, degree: int) -> None:
    """Put a node on its degree's stack, if there is one."""
    if degree >= len(queue.top):
        return
    queue.above[v], queue.below[v], queue.stands[v] = -1, queue.top[degree], degree
    if queue.top[degree] >= 0:
        queue.above[queue.top[degree]] = v
    queue.top[degree] = v


@jit
def _pull(queue: _Queue, v: int) -> None:
    """Take a node off its stack."""
    if queue.stands[v] < 0:
        return
    if queue.above[v] >= 0:
        queue.below[queue.above[v]] = queue.below[v]
    else:
        queue.top[queue.stands[v]] = queue.below[v]
    if queue.below[v] >= 0:
        queue.above[queue.below[v]] = queue.above[v]
    queue.stands[v] = -1


@jit
def _full_queue(degree: Small, most: int) -> _Queue:
    """All nodes of at most so many neighbours, the first of each degree on top."""
    count = len(degree)
    queue = _Queue(
        np.full(most + 1, -1, np.int32),
        np.full(count, -1, np.int32),
        np.full(count, -1, np.int32),
        np.full(count, -1, np.int32),
    )
    for v in range(count - 1, -1, -1):
        _push(queue, v, degree[v])
    return queue


@jit
def _take_given(
    first: Small, last: Small, lists: _Lists, pool: Small, by: Small, ends: Small
) -> Small:
    """Put the given links into the lists; return which one each counts to."""
    of_given = np.empty(len(first), np.int32)
    for k in range(len(first)):
        a, b = first[k], last[k]
        ends[2 * k], ends[2 * k + 1] = a, b
        same = _between(lists, pool, by, a, b)
        of_given[k] = k if same < 0 else same
        if same < 0:
            _add(lists, pool, by, a, b, k)
            _add(lists, pool, by, b, a, k)
    return of_given


@jit
def _plan(
    first: Small, last: Small, count: int, most: int
) -> tuple[Small, IntArray, Small, Small, Small, Small, Small]:
    """Eliminate nodes by their neighbours' lists alone, no numbers; `StarMesh`'s first seven."""
    lists = _empty_lists(first, last, count)
    pool = np.empty(2 * lists.end[0] + 64, np.int32)
    by = np.empty(len(pool), np.int32)
    links = len(first)
    ends = np.empty(4 * links + 64, np.int32)
    of_given = _take_given(first, last, lists, pool, by, ends)
    queue = _full_queue(lists.degree, most)
    order, begin, steps = np.empty(count, np.int32), np.zeros(count + 1, np.int64), 0
    neighbour, link, entries = np.empty(4 * count, np.int32), np.empty(4 * count, np.int32), 0
    pair, pairs = np.empty(6 * count, np.int32), 0
    least = 0
    while True:
        while least <= most and queue.top[least] < 0:
            least += 1
        if least > most:
            break
        v = queue.top[least]
        _pull(queue, v)
        lists.gone[v] = True
        if entries + most > len(neighbour):
            neighbour, link = _longer(neighbour, 0), _longer(link, 0)
        if pairs + most * most > len(pair):
            pair = _longer(pair, pairs + most * most)
        low = entries
        for at in range(lists.start[v], lists.start[v] + lists.used[v]):
            if not lists.gone[pool[at]]:
                neighbour[entries], link[entries] = pool[at], by[at]
                lists.degree[pool[at]] -= 1
                entries += 1
        order[steps] = v
        steps += 1
        begin[steps] = entries
        for i in range(low, entries):
            for j in range(low, i):
                a, b = neighbour[i], neighbour[j]
                between = _between(lists, pool, by, a, b)
                if between < 0:
                    between = links
                    links += 1
                    if 2 * links > len(ends):
                        ends = _longer(ends, 0)
                    ends[2 * between], ends[2 * between + 1] = a, b
                    for node, other in ((a, b), (b, a)):
                        if lists.used[node] == lists.room[node]:
                            pool, by = _make_room(lists, pool, by, node)
                        _add(lists, pool, by, node, other, between)
                pair[pairs] = between
                pairs += 1
        for i in range(low, entries):
            a = neighbour[i]
            degree = lists.degree[a]
            if queue.stands[a] != degree:
                _pull(queue, a)
                _push(queue, a, degree)
                least = min(least, degree)
    return (
        order[:steps].copy(),
        begin[: steps + 1].copy(),
        neighbour[:entries].copy(),
        link[:entries].copy(),
        pair[:pairs].copy(),
        ends[: 2 * links].copy().reshape((links, 2)),
        of_given,
    )
