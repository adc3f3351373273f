"""Reader of `network.csv`, and collisions, Murray's law and flows of what it holds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from benchmarks.checkers.compiled import compiled
from benchmarks.checkers.meshes import box_tree, first_in, meets, segment_segment

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

WHOLE = ("vessel", "node0", "node1", "tree")
NUMBERS = ("x0", "y0", "z0", "x1", "y1", "z1", "radius0_mm", "radius1_mm")
COLUMNS = dict.fromkeys(WHOLE, "i8") | dict.fromkeys(NUMBERS, "f8") | {"kind": "U12"}


@dataclass(frozen=True)
class Pieces:
    """Straight pieces (n,) of vessels, nodes numbered from 0 without gaps; mm.

    ``node`` (n, 2), ``radius`` (n, 2) and ``start``, ``end`` (n, 3): designed flow runs from the
    first to the second.
    """

    vessel: IntArray
    tree: IntArray
    kind: NDArray[np.str_]
    node: IntArray
    start: FloatArray
    end: FloatArray
    radius: FloatArray

    @property
    def count(self) -> int:
        """Number of pieces."""
        return len(self.node)

    @property
    def node_count(self) -> int:
        """Number of nodes."""
        return int(self.node.max()) + 1

    @property
    def length(self) -> FloatArray:
        """(n,), mm."""
        length: FloatArray = np.linalg.norm(self.end - self.start, axis=1)
        return length

    @property
    def widest(self) -> FloatArray:
        """Larger radius of each piece, (n,), mm."""
        widest: FloatArray = self.radius.max(axis=1)
        return widest

    def inlets(self) -> IntArray:
        """Nodes that pieces leave and none enters."""
        return np.setdiff1d(self.node[:, 0], self.node[:, 1])

    def outlets(self) -> IntArray:
        """Nodes that pieces enter and none leaves."""
        return np.setdiff1d(self.node[:, 1], self.node[:, 0])


def read_network(path: Path) -> Pieces:
    """Read the pieces of a file in mm; refuse one without all columns (see `pieces_of`, too)."""
    with path.open(encoding="utf-8") as lines:
        names = [name.strip() for name in lines.readline().split(",")]
        missing = set(COLUMNS) - set(names)
        if missing:
            raise ValueError(f"{path}: no column {', '.join(sorted(missing))}")
        row = np.dtype([(name, COLUMNS.get(name, "U64")) for name in names])
        table = np.loadtxt(lines, delimiter=",", dtype=row, ndmin=1)
    return pieces_of(
        start=np.column_stack([table["x0"], table["y0"], table["z0"]]),
        end=np.column_stack([table["x1"], table["y1"], table["z1"]]),
        radius=np.column_stack([table["radius0_mm"], table["radius1_mm"]]),
        node=np.column_stack([table["node0"], table["node1"]]),
        vessel=table["vessel"].copy(),
        tree=table["tree"].copy(),
        kind=table["kind"].copy(),
    )


def pieces_of(
    start: FloatArray,
    end: FloatArray,
    radius: FloatArray,
    node: IntArray,
    vessel: IntArray | None = None,
    tree: IntArray | None = None,
    kind: NDArray[np.str_] | None = None,
) -> Pieces:
    """Make pieces of arrays; ``radius`` may be (n,) where pieces don't taper.

    Raises ValueError where a number isn't finite, a radius isn't above 0, or pieces that share a
    node number don't meet within a nanometre.
    """
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    radius = np.asarray(radius, dtype=np.float64)
    if radius.ndim == 1:
        radius = np.column_stack([radius, radius])
    _, number = np.unique(np.asarray(node), return_inverse=True)
    number = number.reshape(-1, 2).astype(np.int64)
    _check(start, end, radius, number)
    n = len(start)
    vessel = np.arange(n) if vessel is None else vessel
    tree = np.zeros(n, dtype=np.int64) if tree is None else tree
    kind = np.full(n, "artery") if kind is None else kind
    return Pieces(vessel, tree, kind, number, start, end, radius)


def _check(start: FloatArray, end: FloatArray, radius: FloatArray, node: IntArray) -> None:
    if not (np.isfinite(start).all() and np.isfinite(end).all()):
        raise ValueError("a coordinate is NaN or infinite")
    if not (np.isfinite(radius).all() and (radius > 0).all()):
        raise ValueError("a radius is NaN, infinite or not above 0")
    place = np.empty((int(node.max()) + 1, 3))
    place[node[:, 0]] = start
    place[node[:, 1]] = end
    apart = max(np.abs(place[node[:, 0]] - start).max(), np.abs(place[node[:, 1]] - end).max())
    if apart > 1e-6:
        raise ValueError(f"pieces that share a node lie {apart:g} mm apart")


def parents(net: Pieces) -> IntArray:
    """The piece that enters each piece's first node, (n,), or -1."""
    entering = np.full(net.node_count, -1, dtype=np.int64)
    entering[net.node[:, 1]] = np.arange(net.count)
    return entering[net.node[:, 0]]


@compiled
def from_roots(parent: Any) -> Any:
    """Pieces ordered so that parents come first; fewer than all where there is a cycle."""
    waiting = np.zeros(len(parent), np.int64)
    for p in parent:
        if p >= 0:
            waiting[p] += 1
    order, behind = np.empty(len(parent), np.int64), 0
    for i in range(len(parent)):
        if waiting[i] == 0:
            order[behind] = i
            behind += 1
    at = 0
    while at < behind:
        p = parent[order[at]]
        at += 1
        if p >= 0:
            waiting[p] -= 1
            if waiting[p] == 0:
                order[behind] = p
                behind += 1
    return order[:behind][::-1].copy()


def ways_within(
    net: Pieces, pairs: NDArray[np.int64], limit: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whether the shortest way between both pieces of each pair (k, 2) is within its limit, (k,).

    The way runs from an end of the one to an end of the other, over whatever vessels join them,
    loops included; pieces of unconnected trees have none.
    """
    ends = net.node.ravel()
    order = np.argsort(ends, kind="stable")
    first = np.concatenate([[0], np.cumsum(np.bincount(ends, minlength=net.node_count))])
    within: NDArray[np.bool_] = _within(pairs, limit, net.node, net.length, first, order // 2)
    return within


@compiled
def _within(pairs: Any, limit: Any, node: Any, length: Any, first: Any, piece_at: Any) -> Any:
    """From both ends of one piece, relax nodes in turn until none gets nearer.

    A node whose way would exceed the limit isn't queued, so that only the surroundings of a pair
    are walked.
    """
    nodes = len(first) - 1
    stamp = np.full(nodes, -1, np.int64)
    way = np.empty(nodes)
    result = np.zeros(len(pairs), np.bool_)
    for k in range(len(pairs)):
        one, two = pairs[k, 0], pairs[k, 1]
        queue = [node[one, 0], node[one, 1]]
        for begin in queue:
            stamp[begin], way[begin] = k, 0.0
        at = 0
        while at < len(queue):
            here = queue[at]
            at += 1
            for entry in range(first[here], first[here + 1]):
                piece = piece_at[entry]
                there = node[piece, 0] + node[piece, 1] - here
                further = way[here] + length[piece]
                if further <= limit[k] and (stamp[there] != k or further < way[there]):
                    stamp[there], way[there] = k, further
                    queue.append(there)
        result[k] = stamp[node[two, 0]] == k or stamp[node[two, 1]] == k
    return result


ROUNDING_MM = 1e-9


@dataclass(frozen=True)
class Near:
    """Pairs (k, 2), first below second, that share no node and come nearer than the clearance.

    ``gap`` (k,), mm, between the walls, negative where they overlap; ``joint``: within one joint;
    the others collide.
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
    """Find all near pairs of a network.

    The clearance is the larger of ``clearance_mm`` and ``clearance_ratio`` times the thinner
    radius. A pair that is nearer collides when the way between the two along the vessels is longer
    than twice the sum of their radii plus the clearance. A tapered piece counts as wide as its
    wider end. What is nearer by less than a picometre isn't counted: it is rounding.
    """
    radius = net.widest
    reach = (radius + 0.5 * np.maximum(clearance_mm, clearance_ratio * radius))[:, None]
    low = np.minimum(net.start, net.end) - reach
    high = np.maximum(net.start, net.end) + reach
    tree = box_tree(low, high)
    order = tree.order
    found, gap = _near(
        tree.around, tree.levels, low[order], high[order], net.start[order], net.end[order],
        radius[order], net.node[order], clearance_mm, clearance_ratio,
    )  # fmt: skip
    pairs = np.sort(order[found], axis=1)
    by_number = np.lexsort((pairs[:, 1], pairs[:, 0]))
    pairs, gap = pairs[by_number], gap[by_number]
    thinner = radius[pairs].min(axis=1)
    limit = 2.0 * radius[pairs].sum(axis=1)
    limit += np.maximum(clearance_mm, clearance_ratio * thinner)
    return Near(pairs, gap, ways_within(net, pairs, limit))


@compiled
def _near(
    around: Any, levels: int, low: Any, high: Any, start: Any, end: Any, radius: Any, node: Any,
    clearance_mm: float, clearance_ratio: float,
) -> Any:  # fmt: skip
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
                a, b, c, d = node[i, 0], node[i, 1], node[j, 0], node[j, 1]
                if a in (c, d) or b in (c, d):
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


def murray_ratios(net: Pieces, exponent: float = 3.0) -> FloatArray:
    """Σ r^γ leaving over Σ r^γ entering at each node where vessels branch, (b,); 1 is exact."""
    leaving, entering = (
        np.bincount(net.node[:, k], net.radius[:, k] ** exponent, net.node_count) for k in (0, 1)
    )
    degree = np.bincount(net.node.ravel(), minlength=net.node_count)
    branching = (entering > 0) & (leaving > 0) & (degree > 2)
    return leaving[branching] / entering[branching]


def murray_residual(net: Pieces, exponent: float = 3.0) -> float:
    """Largest |Σ r^γ leaving / Σ r^γ entering - 1|."""
    ratios = murray_ratios(net, exponent)
    return float(np.abs(ratios - 1.0).max()) if len(ratios) else 0.0


@dataclass(frozen=True)
class Perfusion:
    """What a tree's radii are derived from."""

    flow_ul_s: float
    drop_pa: float
    viscosity_pa_s: float
    murray_exponent: float = 3.0


def consistent_radii(net: Pieces, perfusion: Perfusion) -> FloatArray:
    """Return radii (n,), mm, with which a binary tree keeps Murray's law and feeds outlets alike.

    Only geometry and topology of ``net`` are used. With equal pressures behind all outlets the
    flow through two branches is in the ratio Q_l / Q_r = (r_l⁴ / R*_l) / (r_r⁴ / R*_r), so that
    (r_l / r_r)⁴ = Q_l R*_l / Q_r R*_r; Murray's law does the rest (Karch et al. 1999,
    doi 10.1016/S0010-4825(98)00045-6). Here a branch's load L = Q R* replaces both:
    r_l / r_r = (L_l / L_r)^¼, and the parent's own is L = 8 μ ℓ Q / π + L_l (r_parent / r_l)⁴.
    """
    parent = parents(net)
    children = np.bincount(parent[parent >= 0], minlength=net.count)
    order = from_roots(parent)
    if (parent < 0).sum() != 1 or not np.isin(children, (0, 2)).all() or len(order) < net.count:
        raise ValueError("the network isn't one binary tree")
    each = perfusion.flow_ul_s / len(net.outlets())
    load = 8.0 * perfusion.viscosity_pa_s / np.pi * each * net.length
    radii: FloatArray = _radii(parent, order, load, perfusion.drop_pa, perfusion.murray_exponent)
    return radii


@compiled
def _radii(parent: Any, order: Any, unit_load: Any, drop_pa: float, gamma: float) -> Any:
    n = len(parent)
    load, share, terminals = np.zeros(n), np.ones(n), np.zeros(n)
    first = np.full(n, -1, np.int64)
    for k in range(n - 1, -1, -1):
        i = order[k]
        terminals[i] = max(1.0, terminals[i])
        load[i] += unit_load[i] * terminals[i]
        p = parent[i]
        if p < 0:
            continue
        terminals[p] += terminals[i]
        if first[p] < 0:
            first[p] = i
            continue
        j = first[p]
        wider = (load[i] / load[j]) ** 0.25
        share[i] = (1.0 + wider**-gamma) ** (-1.0 / gamma)
        share[j] = (1.0 + wider**gamma) ** (-1.0 / gamma)
        load[p] = load[i] / share[i] ** 4
    radius = np.empty(n)
    for i in order:
        p = parent[i]
        radius[i] = (load[i] / drop_pa) ** 0.25 if p < 0 else radius[p] * share[i]
    return radius


def resistances(net: Pieces, viscosity_pa_s: float) -> FloatArray:
    """Resistance of each piece, (n,), Pa·s/mm³.

    (8 μ / π) ∫ dx / r⁴ over a straight taper: (8 μ ℓ / 3 π) (r0² + r0 r1 + r1²) / (r0³ r1³).
    """
    r0, r1 = net.radius.T
    shape = (r0 * r0 + r0 * r1 + r1 * r1) / (3.0 * (r0 * r1) ** 3)
    found: FloatArray = 8.0 * viscosity_pa_s / np.pi * net.length * shape
    return found


def outlet_flows(net: Pieces, drop_pa: float, viscosity_pa_s: float) -> FloatArray:
    """Flow out of each of `Pieces.outlets`, (t,), µL/s: all inlets at ``drop_pa``, outlets at 0.

    Trees are solved by elimination from the leaves, which adds only positive numbers and so
    loses no digits; what has loops by a sparse factorisation.
    """
    resistance = resistances(net, viscosity_pa_s)
    flow = tree_flows(net, resistance, drop_pa)
    if flow is None:
        flow = graph_flows(net, resistance, drop_pa)
    into = np.zeros(net.node_count)
    np.add.at(into, net.node[:, 1], flow)
    found: FloatArray = into[net.outlets()]
    return found


def loop_flows(net: Pieces, drop_pa: float, viscosity_pa_s: float) -> FloatArray:
    """Flow through each vessel of kind connection, (c,), µL/s; inlets at ``drop_pa``."""
    flow = graph_flows(net, resistances(net, viscosity_pa_s), drop_pa)
    connection = np.flatnonzero(net.kind == "connection")
    if len(connection) == 0:
        raise ValueError("the network has no vessel of kind connection")
    # The pieces of a vessel lie in a row: what flows through the first flows through all.
    _, first = np.unique(net.vessel[connection], return_index=True)
    return flow[connection[first]]


def spread(flows: FloatArray) -> float:
    """(max - min) / mean of the terminal flows."""
    return float((flows.max() - flows.min()) / flows.mean())


def tree_flows(net: Pieces, resistance: FloatArray, drop_pa: float) -> FloatArray | None:
    """Flow in each piece, (n,), or None where the network isn't a forest grown from inlets."""
    if np.bincount(net.node[:, 1]).max() > 1:
        return None
    parent = parents(net)
    order = from_roots(parent)
    if len(order) < net.count:
        return None
    flow: FloatArray = _tree_flows(parent, order, resistance, drop_pa)
    return flow


@compiled
def _tree_flows(parent: Any, order: Any, resistance: Any, drop_pa: float) -> Any:
    """Conductances from the leaves up, then flows from the root down in their proportion."""
    n = len(parent)
    below, through = np.zeros(n), np.empty(n)
    for k in range(n - 1, -1, -1):
        i = order[k]
        through[i] = 1.0 / resistance[i]
        if below[i] > 0.0:
            through[i] = 1.0 / (resistance[i] + 1.0 / below[i])
        if parent[i] >= 0:
            below[parent[i]] += through[i]
    flow = np.empty(n)
    for i in order:
        p = parent[i]
        flow[i] = drop_pa * through[i] if p < 0 else flow[p] * (through[i] / below[p])
    return flow


def graph_flows(net: Pieces, resistance: FloatArray, drop_pa: float) -> FloatArray:
    """Flow in each piece of any network, (n,): Kirchhoff's laws by a sparse factorisation."""
    pressure = np.zeros(net.node_count)
    pressure[net.inlets()] = drop_pa
    free = np.setdiff1d(np.arange(net.node_count), np.append(net.inlets(), net.outlets()))
    if len(free):
        matrix, load = _kirchhoff(net.node, 1.0 / resistance, pressure, free)
        factors = splu(matrix)
        pressure[free] = factors.solve(load)
        pressure[free] += factors.solve(load - matrix @ pressure[free])
    return (pressure[net.node[:, 0]] - pressure[net.node[:, 1]]) / resistance


def _kirchhoff(
    node: IntArray, conductance: FloatArray, pressure: FloatArray, free: IntArray
) -> tuple[csc_matrix, NDArray[np.float64]]:
    """Matrix and right-hand side for the pressures of the free nodes."""
    n = len(pressure)
    one, two = node.T
    entries = np.concatenate([conductance, conductance, -conductance, -conductance])
    places = np.concatenate([one, two, one, two]), np.concatenate([one, two, two, one])
    rows = csc_matrix((entries, places), shape=(n, n)).tocsr()[free]
    return rows[:, free].tocsc(), -rows @ pressure
