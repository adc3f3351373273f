"""Solve the flow that carries the dye, through the vessels that are open."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from design.hemodynamics import FlowConditions, FlowSolution, solve_flow
from design.hemodynamics.dye import CarryingFlow, steady_transit
from design.network import VesselNetwork

Nodes = tuple[int, ...]


def open_vessels(
    network: VesselNetwork, inlets: Nodes, outlets: Nodes, closed: Collection[int]
) -> NDArray[np.bool_]:
    """Vessels (v,) that hang together with an inlet and an outlet without the closed ones."""
    left = ~np.isin(np.arange(network.vessel_count), list(closed))
    count = len(network.nodes)
    first, last = network.vessel_nodes[left].T
    joined = coo_array((np.ones(len(first), dtype=np.int8), (first, last)), shape=(count, count))
    parts, part = connected_components(joined, directed=False)
    for ends in (inlets, outlets):
        fed = np.bincount(part[list(ends)], minlength=parts) > 0
        left &= fed[part[network.vessel_nodes[:, 0]]]
    return np.asarray(left)


def solve_open_flow(
    network: VesselNetwork,
    viscosity_pa_s: float,
    inlets: Nodes,
    outlets: Nodes,
    left: NDArray[np.bool_],
) -> FlowSolution:
    """Flow of 1 µL/s through the vessels that are left; none, and no pressure, in the others.

    Raises
    ------
    FlowError
        When what is left has no such flow.
    """
    used, ends = np.unique(network.vessel_nodes[left], return_inverse=True)
    kept = np.repeat(left, np.diff(network.offset))
    part = replace(
        network,
        nodes=network.nodes[used],
        vessel_nodes=ends.reshape(-1, 2),
        kind=network.kind[left],
        tree=network.tree[left],
        offset=np.concatenate([[0], np.cumsum(np.diff(network.offset)[left])]),
        points=network.points[kept],
        radius=network.radius[kept],
    )
    slot = {node: k for k, node in enumerate(used.tolist())}
    at_in, at_out = (tuple(slot[n] for n in side if n in slot) for side in (inlets, outlets))
    solution = solve_flow(
        part, FlowConditions(viscosity_pa_s, inlet_flow_ul_s=1.0, inlets=at_in, outlets=at_out)
    )
    pressure = np.zeros(len(network.nodes))
    pressure[used] = solution.pressure

    def spread(values: NDArray[np.float64], other: float) -> NDArray[np.float64]:
        whole = np.full(network.vessel_count, other)
        whole[left] = values
        return whole

    return FlowSolution(
        pressure=pressure,
        flow=spread(solution.flow, 0.0),
        velocity=spread(solution.velocity, 0.0),
        wall_shear=spread(solution.wall_shear, 0.0),
        resistance=spread(solution.resistance, np.inf),
    )


_WATER = 1e-3


def carrying_flow(network: VesselNetwork, inlet: int | None) -> CarryingFlow:
    """Solve the flow of 1 µL/s.

    Raises
    ------
    FlowError
        When the network has no such flow.
    """
    inlets, outlets = _ends(network, inlet)
    conditions = FlowConditions(_WATER, inlet_flow_ul_s=1.0, inlets=inlets, outlets=outlets)
    return steady_transit(network, solve_flow(network, conditions), inlets)


def solve_without_closed(
    network: VesselNetwork, inlet: int | None, closed: Collection[int]
) -> CarryingFlow | None:
    """Solve the flow of 1 µL/s without the vessels that are closed.

    They are taken out whole: a closure that leaks isn't told from one that doesn't.

    Returns
    -------
    Carried or None
        Of the whole network, at rest in the closed vessels and in what they cut off; None where
        nothing is left that leads from an inlet to an outlet.
    """
    inlets, outlets = _ends(network, inlet)
    left = open_vessels(network, inlets, outlets, closed)
    if not left.any():
        return None
    return steady_transit(network, solve_open_flow(network, _WATER, inlets, outlets, left), inlets)


def _ends(network: VesselNetwork, inlet: int | None) -> tuple[Nodes, Nodes]:
    """Nodes that dye enters and leaves by."""
    if inlet is None:
        return tuple(network.inlets().tolist()), tuple(network.outlets().tolist())
    return (inlet,), _opposite(network, inlet)


def _opposite(network: VesselNetwork, inlet: int) -> Nodes:
    """Open ends that dye let in at ``inlet`` leaves by; from a designed outlet, by all others."""
    starts, ends = network.inlets().tolist(), network.outlets().tolist()
    return tuple(node for node in (*starts, *ends) if node != inlet) if inlet in ends else (*ends,)
