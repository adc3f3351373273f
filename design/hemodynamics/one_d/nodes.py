"""Set up node arrays of the 1D solver from junctions and inlet and outlet conditions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from design.errors import FlowError
from design.hemodynamics.one_d.grid import Grid
from design.hemodynamics.waveforms import Waveform
from design.hemodynamics.zero_d.boundary import (
    boundary_nodes,
    check_parts,
    number_unknowns,
    refuse_supplies,
)
from design.hemodynamics.zero_d.pulsatile.conditions import (
    Outlet,
    PressureOutlet,
    PulsatileConditions,
    ResistanceOutlet,
    WindkesselOutlet,
)
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray

JUNCTION: Final = 0
PRESSURE: Final = 1
RESISTANCE: Final = 2
REFLECTION: Final = 3


class Nodes(NamedTuple):
    """Nodes by the vessel ends that meet there.

    End ``2 k`` is vessel k's first, ``2 k + 1`` its last.

    Attributes
    ----------
    start : (m + 1,) int64
        Ends of node ``j`` are ``end[start[j]:start[j + 1]]``.
    end : (2 v,) int64
    kind : (m,) int64
        `JUNCTION` (with a flow from outside, where it has a wave), `PRESSURE`, `RESISTANCE` (the
        first of a Windkessel, or all there is) or `REFLECTION`.
    wave : (m,) int64
        Row of what drives it, -1 for none.
    proximal, distal, capacitance, back : (m,) float64, Pa·s/µL, Pa·s/µL, µL/Pa, Pa
        Of outlets; without a capacitance the pressure behind `proximal` stays at `back`.
    reflection : (m,) float64
    """

    start: IntArray
    end: IntArray
    kind: IntArray
    wave: IntArray
    proximal: FloatArray
    distal: FloatArray
    capacitance: FloatArray
    back: FloatArray
    reflection: FloatArray


def place_nodes(
    network: VesselNetwork, conditions: PulsatileConditions, reflection: Mapping[int, float]
) -> tuple[Nodes, IntArray, tuple[Waveform, ...]]:
    """Nodes, which of them each of the network's is (inlets on one flow share theirs), waves.

    Raises
    ------
    FlowError
        No inlet, no outlet, an isolated part, an outlet without a condition, a reflection where
        it can't be.
    """
    refuse_supplies(conditions.supplies, "1D flow")
    inlets, outlets = boundary_nodes(network, conditions)
    check_parts(network, inlets, outlets)
    slot = np.arange(len(network.nodes))
    if conditions.inlet_is == "flow":
        slot[inlets] = inlets[0]
    (slot,) = number_unknowns(slot)
    nodes = _junctions(slot[network.vessel_nodes].ravel(), int(slot.max()) + 1)
    nodes.wave[slot[inlets]] = 0
    if conditions.inlet_is == "pressure":
        nodes.kind[slot[inlets]] = PRESSURE
    waves: list[Waveform] = [conditions.inlet]
    strangers = sorted(set(reflection) - set(outlets.tolist()))
    if strangers:
        raise FlowError(f"node {strangers[0]} has a reflection and isn't one of the outlets")
    for node in outlets.tolist():
        place = int(slot[node])
        _attach(nodes, place, outlet_of(conditions.outlet, node), waves)
        if node in reflection:
            _reflect(nodes, node, place, reflection[node])
    return nodes, slot, tuple(waves)


def _junctions(at: IntArray, count: int) -> Nodes:
    """So many nodes, of which vessel ends are ``at`` (2 v,), with nothing asked of any."""
    nothing = np.zeros(count)
    return Nodes(
        start=np.concatenate([[0], np.cumsum(np.bincount(at, minlength=count))]),
        end=np.argsort(at, kind="stable"),
        kind=np.full(count, JUNCTION),
        wave=np.full(count, -1),
        proximal=nothing.copy(),
        distal=nothing.copy(),
        capacitance=nothing.copy(),
        back=nothing.copy(),
        reflection=nothing,
    )


def outlet_of(given: Outlet | Mapping[int, Outlet], node: int) -> Outlet:
    """The condition of one outlet.

    Raises
    ------
    FlowError
        When it has none.
    """
    if not isinstance(given, Mapping):
        return given
    if node not in given:
        raise FlowError(
            f"outlet {node} has no condition; give it a pressure, a resistance or a Windkessel"
        )
    return given[node]


def _attach(nodes: Nodes, place: int, outlet: Outlet, waves: list[Waveform]) -> None:
    if isinstance(outlet, PressureOutlet):
        nodes.kind[place] = PRESSURE
        if outlet.waveform not in waves[1:]:
            waves.append(outlet.waveform)
        nodes.wave[place] = 1 + waves[1:].index(outlet.waveform)
        return
    nodes.kind[place], nodes.back[place] = RESISTANCE, outlet.distal_pa
    if isinstance(outlet, ResistanceOutlet):
        nodes.proximal[place] = outlet.resistance
    elif isinstance(outlet, WindkesselOutlet):
        nodes.proximal[place], nodes.distal[place] = outlet.proximal, outlet.distal
        nodes.capacitance[place] = outlet.compliance


def _reflect(nodes: Nodes, node: int, place: int, part: float) -> None:
    if nodes.kind[place] != PRESSURE:
        raise FlowError(
            f"outlet {node} has a reflection, and a resistance of its own; give it a pressure, "
            "about which waves are sent back"
        )
    if nodes.start[place + 1] - nodes.start[place] != 1:
        raise FlowError(f"several vessels meet at outlet {node}; a reflection is for one")
    nodes.kind[place], nodes.reflection[place] = REFLECTION, part


def end_impedance(grid: Grid) -> FloatArray:
    """ϱ c/A at rest of each vessel's ends, (2 v,), Pa·s/µL."""
    faces = (
        np.column_stack([grid.offset[:-1], grid.offset[1:]]) + np.arange(len(grid.cell))[:, None]
    )
    speed = np.sqrt(grid.face_stiffness / (2.0 * grid.density))
    return np.asarray((grid.density * speed / grid.face_area)[faces].ravel())
