"""Choose the ends that dye enters and leaves by; solve the 1 µL/s flow that carries it."""

from __future__ import annotations

from collections.abc import Collection

from design.hemodynamics import FlowConditions, solve_flow
from design.hemodynamics.dye import CarryingFlow, steady_transit
from design.network import VesselNetwork
from registration.dye.open_flow import Nodes, open_vessels, solve_open_flow

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
