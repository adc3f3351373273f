"""Cut each branch off a tree and graft it onto another segment if total cost falls.

The move is the subtree transfer of Guy et al. 2019 (doi 10.1109/TBME.2019.2942313) and Jessen et
al. 2024 (arXiv 2410.06002), with the exact cost of the whole tree: cutting leaves a straight
segment in place of two, grafting parts another in two.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from design.vasculature.growth.clearances import Clearances, TrialBifurcation, neighbours_of
from design.vasculature.growth.cost import joined_load
from design.vasculature.growth.index import REACH, CellIndex, insert, nearest_segments
from design.vasculature.options import Law
from design.vasculature.polish.cost import fork_slopes, relengthened, walk_up
from design.vasculature.polish.fit import far_end, length_of, near_end
from design.vasculature.polish.graft_fit import branch_fits, fork_fits, straight_fits, way_fits
from design.vasculature.polish.relax import GAIN, all_radii
from design.vasculature.polish.topology import attach, cut_branch, detach, is_below, undo_cut
from kernels import jit

CANDIDATES = 10
"""Segments nearest to a branch's far end, and as many to its middle, that it may join."""

TRIED = 4
"""Of these the cheapest that are tried."""

_WEISZFELD = 8
_FRESH = 64


@jit
def _fork_at(segments: Any, i: Any, c: Any, b: Any, law: Law) -> Any:
    """Lengths, loads and spends of the lower part of ``i`` and of branch ``c`` from ``b``."""
    s, branch = segments[i], segments[c]
    up, low, new = (
        length_of(near_end(s), b),
        length_of(b, far_end(s)),
        length_of(b, far_end(branch)),
    )
    load0, spend0 = relengthened(s, low, law)
    load1, spend1 = relengthened(branch, new, law)
    return (up, low, new), (load0, load1), (spend0, spend1)


@jit
def _weights(s: Any, branch: Any) -> tuple[float, float, float]:
    """Flow times viscosity above a fork of ``branch`` on ``s``, and of its two parts."""
    both = (s.flow + branch.flow) * s.thick
    return both, s.flow * s.thick, branch.flow * branch.thick


@jit
def _best_fork(segments: Any, i: Any, c: Any, law: Law) -> tuple[float, float, float]:
    """Best place on segment ``i`` for branch ``c``: Weiszfeld's iteration with live weights."""
    s, branch = segments[i], segments[c]
    p, d, t = near_end(s), far_end(s), far_end(branch)
    bx, by, bz = (p[0] + d[0] + t[0]) / 3.0, (p[1] + d[1] + t[1]) / 3.0, (p[2] + d[2] + t[2]) / 3.0
    for _ in range(_WEISZFELD):
        lengths, loads, spends = _fork_at(segments, i, c, (bx, by, bz), law)
        w, w0, w1 = fork_slopes(
            (s.by_load, s.by_spend), lengths, loads, spends, _weights(s, branch), law
        )
        w = max(0.0, w) / lengths[0]
        w0, w1 = max(0.0, w0) / lengths[1], max(0.0, w1) / lengths[2]
        total = w + w0 + w1
        if not total > 0.0:
            break
        nx = (w * p[0] + w0 * d[0] + w1 * t[0]) / total
        ny = (w * p[1] + w0 * d[1] + w1 * t[1]) / total
        nz = (w * p[2] + w0 * d[2] + w1 * t[2]) / total
        moved = abs(nx - bx) + abs(ny - by) + abs(nz - bz)
        bx, by, bz = nx, ny, nz
        if moved < 1e-3 * s.length:
            break
    return bx, by, bz


@jit
def fork_cost(
    segments: Any, i: Any, c: Any, b: Any, flow_over_drop: float, law: Law
) -> tuple[float, TrialBifurcation]:
    """Cost of the tree with the cut branch ``c`` on segment ``i`` at ``b``, and the fork."""
    s, branch = segments[i], segments[c]
    lengths, loads, spends = _fork_at(segments, i, c, b, law)
    n = s.flow + branch.flow
    weight = n * s.thick
    load, spend, m = joined_load(loads[0], spends[0], loads[1], spends[1], lengths[0], weight, law)
    cost, radius4 = walk_up(segments, i, load, spend, n, law)
    radius = np.sqrt(np.sqrt(flow_over_drop * radius4))
    t = far_end(branch)
    low, new = np.sqrt(np.sqrt(loads[0] / m)), np.sqrt(np.sqrt(loads[1] / m))
    return cost, TrialBifurcation(
        np.int64(i),
        b[0],
        b[1],
        b[2],
        t[0],
        t[1],
        t[2],
        radius,
        radius * low,
        radius * new,
        branch.flow,
        branch.thick,
    )


@jit
def _candidates(segments: Any, index: CellIndex, c: Any, p: Any, a: Any, nearest: Any) -> int:
    """Write segments near branch ``c`` that it may join into ``nearest``, each once."""
    near = np.empty(CANDIDATES, np.int32)
    away = np.empty(CANDIDATES)
    s = segments[c]
    size = 0
    for part in (1.0, 0.5):
        if part < 1.0 and s.left < 0:
            break
        x = s.px + part * (s.dx - s.px)
        y = s.py + part * (s.dy - s.py)
        z = s.pz + part * (s.dz - s.pz)
        got = nearest_segments(index, segments, x, y, z, 0.0, near, away)
        for n in range(got):
            i = near[n]
            # Another tree's segment has no parent.
            if i in (0, p, a) or segments[i].parent < 0 or is_below(segments, i, c):
                continue
            known = False
            for m in range(size):
                known = known or nearest[m] == i
            if not known:
                nearest[size] = i
                size += 1
    return size


@jit
def _rank(
    segments: Any, c: int, nearest: Any, places: Any, flow_over_drop: float, law: Law
) -> tuple[Any, Any]:
    """Costs of the cut branch ``c`` at its best place on each segment found, and their order."""
    costs = np.empty(len(nearest))
    for n in range(len(nearest)):
        b = _best_fork(segments, nearest[n], c, law)
        places[n, 0], places[n, 1], places[n, 2] = b
        costs[n], _ = fork_cost(segments, nearest[n], c, b, flow_over_drop, law)
    return costs, np.argsort(costs, kind="mergesort")


@jit
def _try_fork(
    segments: Any,
    index: CellIndex,
    room: Clearances,
    law: Law,
    flow_over_drop: float,
    fork: TrialBifurcation,
    c: Any,
    free: Any,
    below: float,
    saved: Any,
) -> bool:
    """Hang the cut branch ``c`` on a fork if it fits, all its way to the root too."""
    if not fork_fits(index, segments, room, fork, c, free):
        return False
    if not branch_fits(segments, c, fork.new / saved[2].radius):
        return False
    saved[3] = segments[fork.segment]
    attach(segments, fork, c, free, law)
    if segments[0].spend < below and way_fits(segments, fork.segment, flow_over_drop, law):
        return True
    detach(segments, fork.segment, free, saved[3], law)
    segments[c] = saved[2]
    return False


@jit
def _list_anew(segments: Any, index: CellIndex, room: Clearances, i: Any) -> bool:
    """List a moved segment; how wide it may grow is unknown until the next audit."""
    s = segments[i]
    s.allowed = np.inf
    return insert(index, i, s, REACH * s.radius + room.clearance)


@jit
def graft_branch(
    segments: Any,
    index: CellIndex,
    room: Clearances,
    law: Law,
    flow_over_drop: float,
    c: Any,
    heat: float,
    saved: Any,
) -> int:
    """Move branch ``c`` to where the tree costs less: 0 stayed, 1 moved, 2 and index full.

    It may cost more by ``heat`` times the mean cost of a segment.
    """
    parent, sibling, _, _ = neighbours_of(segments, c)
    p, a = int(parent), int(sibling)
    if p <= 0:
        return 0
    below = segments[0].spend * (1.0 + (heat - GAIN) / len(segments))
    nearest = np.empty(2 * CANDIDATES, np.int32)
    size = _candidates(segments, index, c, p, a, nearest)
    if size == 0:
        return 0
    cut_branch(segments, c, saved, law)
    places = np.empty((size, 3))
    costs, order = _rank(segments, c, nearest[:size], places, flow_over_drop, law)
    s = segments[p]
    _, radius4 = walk_up(segments, p, s.load, s.spend, s.flow, law)
    radius = min(s.radius, np.sqrt(np.sqrt(flow_over_drop * radius4)))
    if costs[order[0]] < below and straight_fits(index, segments, room, p, c, a, radius):
        s.radius = radius
        # The fork mustn't run into the new straight.
        done = _list_anew(segments, index, room, p)
        for rank in range(min(TRIED, size)):
            n = order[rank]
            if not costs[n] < below:
                break
            b = (places[n, 0], places[n, 1], places[n, 2])
            _, fork = fork_cost(segments, nearest[n], c, b, flow_over_drop, law)
            if _try_fork(segments, index, room, law, flow_over_drop, fork, c, a, below, saved):
                for i in (p, int(fork.segment), a, int(c)):
                    listed = _list_anew(segments, index, room, i)
                    done = done and listed
                return 1 if done else 2
    undo_cut(segments, p, a, c, saved, law)
    return 0


@jit
def graft(
    segments: Any,
    index: CellIndex,
    room: Clearances,
    law: Law,
    flow_over_drop: float,
    branches: Any,
    first: int,
    heat: float,
) -> tuple[int, int]:
    """Graft ``branches[first:]`` in turn.

    Returns
    -------
    int, int
        The next one (before the end when the index is full), and how many moved.
    """
    saved = segments[:4].copy()
    moved, weight = 0, 0
    fresh = max(_FRESH, len(branches) // _FRESH)
    for n in range(first, len(branches)):
        done = graft_branch(segments, index, room, law, flow_over_drop, branches[n], heat, saved)
        if done > 0:
            moved += 1
            weight += segments[branches[n]].terminals
            if weight >= fresh:
                all_radii(segments, flow_over_drop, law)
                weight = 0
        if done == 2:
            return n + 1, moved
    return len(branches), moved
