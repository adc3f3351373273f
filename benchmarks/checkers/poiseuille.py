"""Solve Poiseuille flow through the pieces of an exported network, independently."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from benchmarks.checkers.compiled import compiled
from benchmarks.checkers.read_network import FloatArray, IntArray, Pieces
from benchmarks.checkers.tree_order import from_roots, parents


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
    """Flow through each vessel of kind connection, (c,), µL/s: inlets at ``drop_pa``, outlets at 0.

    Raises
    ------
    ValueError
        When there is no connection.
    """
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
    """Flow in each piece of any network, (n,): Kirchhoff's laws by a sparse factorisation.

    Raises
    ------
    RuntimeError
        When a part of the network has neither inlet nor outlet.
    """
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
    full = csc_matrix(
        (
            np.concatenate([conductance, conductance, -conductance, -conductance]),
            (np.concatenate([one, two, one, two]), np.concatenate([one, two, two, one])),
        ),
        shape=(n, n),
    )
    rows = full.tocsr()[free]
    return rows[:, free].tocsc(), -rows @ pressure
