"""Conditions put onto a network's nodes, and refused where they leave a part undetermined."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from design.errors import FlowError
from design.hemodynamics.conditions import FlowConditions
from design.network import FloatArray, IntArray, VesselNetwork


@dataclass(frozen=True)
class Boundary:
    """A flow problem's unknowns.

    Attributes
    ----------
    slot : (m,) int64
        Unknown of each node; inlets on one supply share theirs.
    fixed : (s,) bool
        Whether an unknown's pressure is given.
    pressure : (s,) float64, Pa
        The given pressures, 0 elsewhere.
    injected : (s,) float64, µL/s
        Flow into the network at each unknown, where given.
    """

    slot: IntArray
    fixed: NDArray[np.bool_]
    pressure: FloatArray
    injected: FloatArray


def place_conditions(network: VesselNetwork, conditions: FlowConditions) -> Boundary:
    """Turn `FlowConditions` into unknowns of ``network``.

    Raises
    ------
    FlowError
        No inlet, no outlet, unknown node, isolated part, pressure nowhere given.
    """
    inlets, outlets = boundary_nodes(network, conditions)
    check_parts(network, inlets, outlets)
    given = dict(conditions.outlet_flow_ul_s)
    strangers = set(given) - set(outlets.tolist()) if given else set()
    if strangers:
        raise FlowError(f"outlet_flow_ul_s: node {min(strangers)} isn't one of the outlets")
    slot = np.arange(len(network.nodes))
    fixed = np.zeros(len(slot), dtype=bool)
    pressure, injected = np.zeros(len(slot)), np.zeros(len(slot))
    for node, flow in given.items():
        injected[node] = -flow
    is_free = np.ones(len(slot), dtype=bool)
    is_free[list(given)] = False
    free_outlets = outlets[is_free[outlets]]
    fixed[free_outlets], pressure[free_outlets] = True, conditions.outlet_pressure_pa
    if conditions.inlet_pressure_pa is not None:
        fixed[inlets], pressure[inlets] = True, conditions.inlet_pressure_pa
    elif conditions.inlet_flow_ul_s is not None:
        slot[inlets] = inlets[0]
        injected[inlets[0]] = conditions.inlet_flow_ul_s
    if not fixed.any():
        raise FlowError(
            "every inlet and outlet has a flow, so no pressure is determined; give "
            "inlet_pressure_pa, or leave one outlet to outlet_pressure_pa"
        )
    return Boundary(*joined(slot, fixed, pressure, injected))


def joined(slot: IntArray, *values: NDArray[Any]) -> tuple[Any, ...]:
    """Unknowns numbered without gaps: each node's, and values of those that are used."""
    used = np.zeros(len(slot), dtype=bool)
    used[slot] = True
    return (np.cumsum(used) - 1)[slot], *(value[used] for value in values)


class Ends(Protocol):
    """Conditions that may name nodes where the network's own ends aren't meant."""

    @property
    def inlets(self) -> tuple[int, ...] | None:
        """Nodes that flow comes in by."""
        ...

    @property
    def outlets(self) -> tuple[int, ...] | None:
        """Nodes that it leaves by."""
        ...


def boundary_nodes(network: VesselNetwork, conditions: Ends) -> tuple[IntArray, IntArray]:
    """Inlets and outlets, those asked for or the network's own.

    Raises
    ------
    FlowError
        No inlet, no outlet, unknown node, a node that is both.
    """
    inlets = _nodes(network, conditions.inlets, network.inlets(), "inlet")
    outlets = _nodes(network, conditions.outlets, network.outlets(), "outlet")
    is_inlet = np.zeros(len(network.nodes), dtype=bool)
    is_inlet[inlets] = True
    both = outlets[is_inlet[outlets]]
    if len(both):
        raise FlowError(f"node {int(both[0])} is both an inlet and an outlet; choose one")
    return inlets, outlets


def _nodes(
    network: VesselNetwork, asked: tuple[int, ...] | None, own: IntArray, what: str
) -> IntArray:
    nodes = own if asked is None else np.unique(np.array(asked, dtype=np.int64))
    if len(nodes) == 0:
        raise FlowError(
            f"the network has no {what}: no node that vessels only "
            f"{'leave' if what == 'inlet' else 'enter'}; name one in {what}s"
        )
    outside = nodes[(nodes < 0) | (nodes >= len(network.nodes))]
    if len(outside):
        raise FlowError(
            f"{what} {int(outside[0])} isn't a node of the network (0 to {len(network.nodes) - 1})"
        )
    return nodes


def check_parts(network: VesselNetwork, inlets: IntArray, outlets: IntArray) -> None:
    """Refuse parts without an inlet or an outlet, and nodes without a vessel.

    Raises
    ------
    FlowError
        Naming the first of them.
    """
    count = len(network.nodes)
    bare = np.flatnonzero(network.degree() == 0)
    if len(bare):
        raise FlowError(f"node {int(bare[0])} is isolated: no vessel meets it; remove it")
    first, last = network.vessel_nodes.T
    graph = coo_array((np.ones(len(first), dtype=np.int8), (first, last)), shape=(count, count))
    parts, part = connected_components(graph, directed=False)
    for ends, what in ((inlets, "inlet"), (outlets, "outlet")):
        without = np.bincount(part[ends], minlength=parts) == 0
        if without.any():
            cut_off = np.flatnonzero(without[part[first]])
            raise FlowError(
                f"vessel {int(cut_off[0])} lies in an isolated part without {what} "
                f"({len(cut_off)} such vessels of {network.vessel_count}); join it to the "
                f"network, remove it, or name its {what}"
            )
