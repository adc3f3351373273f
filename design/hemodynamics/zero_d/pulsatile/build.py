"""Build the electrical-analogue circuit of a network under its boundary conditions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from design.errors import FlowError
from design.hemodynamics.vessel_coefficients import (
    PARABOLIC,
    plug_inertance,
    vessel_resistance,
    womersley_number,
)
from design.hemodynamics.waveforms import Constant, Waveform
from design.hemodynamics.zero_d.boundary import (
    boundary_nodes,
    check_parts,
    number_unknowns,
    supplied_inlets,
)
from design.hemodynamics.zero_d.pulsatile.circuit import Circuit
from design.hemodynamics.zero_d.pulsatile.conditions import (
    Outlet,
    PressureOutlet,
    PulsatileConditions,
    ResistanceOutlet,
    WindkesselOutlet,
)
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray


@dataclass
class _Parts:
    """A circuit as it grows: nodes and branches beyond the network's own."""

    nodes: int
    held: list[IntArray] = field(default_factory=list)
    driven: list[tuple[IntArray, int]] = field(default_factory=list)
    stored: list[tuple[IntArray, float]] = field(default_factory=list)
    branches: list[tuple[IntArray, IntArray, float]] = field(default_factory=list)
    waveforms: list[Waveform] = field(default_factory=list)

    def more_nodes(self, count: int) -> IntArray:
        self.nodes += count
        return np.arange(self.nodes - count, self.nodes)

    def push(self, nodes: IntArray, waveform: Waveform, *, hold: bool) -> None:
        self.waveforms.append(waveform)
        self.driven.append((nodes, len(self.waveforms) - 1))
        if hold:
            self.held.append(nodes)

    def join(self, first: IntArray, last: IntArray, resistance: float) -> None:
        self.branches.append((first, last, resistance))


def build_circuit(
    network: VesselNetwork, conditions: PulsatileConditions
) -> tuple[Circuit, IntArray]:
    """The circuit, whose first branches are the vessels, and the node in it of each node (m,).

    Raises
    ------
    FlowError
        No inlet, no outlet, an isolated part, an outlet without a condition, a vessel of zero
        length.
    """
    resistance = vessel_resistance(network, conditions.viscosity_pa_s)
    inlets, outlets = boundary_nodes(network, conditions)
    check_parts(network, inlets, outlets)
    slot = np.arange(len(network.nodes))
    common, own = supplied_inlets(inlets, conditions.supplies)
    for nodes in (*own, *([common] if conditions.inlet_is == "flow" else [])):
        slot[nodes] = nodes[0]
    (slot,) = number_unknowns(slot)
    parts = _Parts(int(slot.max()) + 1)
    parts.push(slot[common], conditions.inlet, hold=conditions.inlet_is == "pressure")
    for nodes, supply in zip(own, conditions.supplies, strict=True):
        parts.push(slot[nodes], Constant(supply.flow_ul_s), hold=False)
    for outlet, nodes in _groups(conditions.outlet, outlets):
        _attach(parts, slot[nodes], outlet)
    vessels = slot[network.vessel_nodes]
    return _circuit(parts, network, conditions, vessels, resistance), slot


def _groups(
    given: Outlet | Mapping[int, Outlet], outlets: IntArray
) -> list[tuple[Outlet, IntArray]]:
    """Each condition and its nodes."""
    if not isinstance(given, Mapping):
        return [(given, outlets)]
    bare = np.setdiff1d(outlets, list(given))
    if len(bare):
        raise FlowError(
            f"outlet {int(bare[0])} has no condition ({len(bare)} of {len(outlets)} such); give "
            "it a pressure, a resistance or a Windkessel"
        )
    strangers = sorted(set(given) - set(outlets.tolist()))
    if strangers:
        raise FlowError(f"node {strangers[0]} has a condition and isn't one of the outlets")
    return [(given[int(node)], np.array([node])) for node in outlets]


def _attach(parts: _Parts, nodes: IntArray, outlet: Outlet) -> None:
    if isinstance(outlet, PressureOutlet):
        parts.push(nodes, outlet.waveform, hold=True)
        return
    far = parts.more_nodes(len(nodes))
    parts.push(far, Constant(outlet.distal_pa), hold=True)
    if isinstance(outlet, ResistanceOutlet):
        parts.join(nodes, far, outlet.resistance)
    elif isinstance(outlet, WindkesselOutlet):
        middle = parts.more_nodes(len(nodes))
        parts.stored.append((middle, outlet.compliance))
        parts.join(nodes, middle, outlet.proximal)
        parts.join(middle, far, outlet.distal)


def _circuit(
    parts: _Parts,
    network: VesselNetwork,
    conditions: PulsatileConditions,
    vessels: IntArray,
    resistance: FloatArray,
) -> Circuit:
    more = [np.full(len(first), r) for first, _, r in parts.branches]
    bare = np.zeros(sum(map(len, more)))
    stored, drive = np.zeros(parts.nodes), np.full(parts.nodes, -1)
    for nodes, amount in parts.stored:
        stored[nodes] += amount
    for nodes, waveform in parts.driven:
        drive[nodes] = waveform
    held = np.zeros(parts.nodes, dtype=bool)
    held[np.concatenate([*parts.held, np.zeros(0, dtype=np.int64)])] = True
    inertance = PARABOLIC * plug_inertance(network, conditions.density)
    alpha = womersley_number(
        network.mean_radius(), 1.0, conditions.viscosity_pa_s, conditions.density
    )
    return Circuit(
        first=np.concatenate([vessels[:, 0], *(first for first, _, _ in parts.branches)]),
        last=np.concatenate([vessels[:, 1], *(last for _, last, _ in parts.branches)]),
        resistance=np.concatenate([resistance, *more]),
        inertance=np.concatenate([inertance, bare]),
        capacitance=np.concatenate([conditions.wall.compliance(network), bare]),
        stored=stored,
        held=held,
        drive=drive,
        waveforms=tuple(parts.waveforms),
        womersley=np.concatenate([alpha, bare]) if conditions.profile == "womersley" else None,
    )
