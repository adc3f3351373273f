"""Translate a network's flow conditions, steady or pulsatile, to the ports of its 3D mesh.

A port either has a velocity profile of a given flow, or a uniform traction: minus its pressure
times its normal. With the Laplace form of viscosity that pressure is the mean pressure over a flat
port exactly, and Poiseuille flow leaves it undisturbed (Heywood, Rannacher & Turek 1996, doi
10.1002/(SICI)1097-0363(19960315)22:5<325::AID-FLD307>3.0.CO;2-Y).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from design.errors import FlowError
from design.hemodynamics.conditions import FlowConditions
from design.hemodynamics.three_d.lumen_mesh import LumenMesh
from design.hemodynamics.waveforms import Constant, Waveform
from design.hemodynamics.zero_d.boundary import refuse_supplies
from design.hemodynamics.zero_d.pulsatile.conditions import (
    Outlet,
    PressureOutlet,
    PulsatileConditions,
    ResistanceOutlet,
    WindkesselOutlet,
)


@dataclass(frozen=True)
class GivenFlow:
    """Flow out of the lumen, µL/s, by ports that share a pressure: a waveform times a factor."""

    waveform: Waveform
    factor: float = 1.0


Law = GivenFlow | ResistanceOutlet | WindkesselOutlet


@dataclass(frozen=True)
class CoupledPorts:
    """Ports of one unknown pressure, and what relates it to their flow."""

    ports: tuple[int, ...]
    law: Law


@dataclass(frozen=True)
class PortPlan:
    """Conditions of all ports.

    Attributes
    ----------
    inflow : int or None
        Port with a velocity profile.
    flow : Waveform
        Into it, µL/s.
    held : tuple of (port, Waveform)
        Pressures, Pa.
    coupled : tuple of CoupledPorts
    outlets : tuple of int
        Ports that flow is meant to leave by.
    womersley : bool
        Profile of each harmonic its own; else Poiseuille's.
    viscosity_pa_s, density : float, Pa·s, Pa·s²/mm²
    """

    inflow: int | None
    flow: Waveform
    held: tuple[tuple[int, Waveform], ...]
    coupled: tuple[CoupledPorts, ...]
    outlets: tuple[int, ...]
    womersley: bool
    viscosity_pa_s: float
    density: float

    def waveforms(self) -> tuple[Waveform, ...]:
        """All that drive it."""
        laws = [c.law.waveform for c in self.coupled if isinstance(c.law, GivenFlow)]
        return (self.flow, *(w for _, w in self.held), *laws)


def steady_plan(mesh: LumenMesh, conditions: FlowConditions, density: float) -> PortPlan:
    """Ports under steady conditions.

    Raises
    ------
    FlowError
        No inlet, no outlet, an unknown node, pressure nowhere given.
    """
    refuse_supplies(conditions.supplies, "3D flow")
    inlets, outlets = _ends(mesh, conditions.inlets, conditions.outlets)
    node_port = {mesh.ports[k].node: k for k in outlets}
    _check_nodes(conditions.outlet_flow_ul_s, node_port, "outlet_flow_ul_s")
    given = {node_port[n]: q for n, q in conditions.outlet_flow_ul_s.items()}
    coupled = [CoupledPorts((k,), GivenFlow(Constant(q))) for k, q in given.items()]
    _check_nodes(conditions.behind, node_port, "behind")
    held: list[tuple[int, Waveform]] = []
    for k in outlets:
        load = conditions.behind.get(mesh.ports[k].node)
        if load is not None and load.resistance > 0.0:
            coupled.append(CoupledPorts((k,), ResistanceOutlet(load.resistance, load.pressure_pa)))
        elif k not in given:
            pressure = conditions.outlet_pressure_pa if load is None else load.pressure_pa
            held.append((k, Constant(pressure)))
    inflow = None
    if conditions.inlet_pressure_pa is not None:
        held += [(k, Constant(conditions.inlet_pressure_pa)) for k in inlets]
        flow = Constant(0.0)
    else:
        flow = Constant(conditions.inlet_flow_ul_s or 0.0)
        inflow = _supply(inlets, flow, coupled)
    if not held and all(isinstance(c.law, GivenFlow) for c in coupled):
        raise FlowError(
            "every inlet and outlet has a flow, so no pressure is determined; give "
            "inlet_pressure_pa, or leave one outlet to outlet_pressure_pa"
        )
    return PortPlan(
        inflow,
        flow,
        tuple(held),
        tuple(coupled),
        outlets,
        False,
        conditions.viscosity_pa_s,
        density,
    )


def pulsatile_plan(mesh: LumenMesh, conditions: PulsatileConditions) -> PortPlan:
    """Ports under pulsatile conditions; the wall is taken as rigid.

    Raises
    ------
    FlowError
        No inlet, no outlet, an unknown node, an outlet without a condition.
    """
    refuse_supplies(conditions.supplies, "3D flow")
    inlets, outlets = _ends(mesh, conditions.inlets, conditions.outlets)
    held: list[tuple[int, Waveform]] = []
    coupled: list[CoupledPorts] = []
    for port, outlet in _outlets(mesh, outlets, conditions.outlet):
        if isinstance(outlet, PressureOutlet):
            held.append((port, outlet.waveform))
        else:
            coupled.append(CoupledPorts((port,), outlet))
    inflow, flow = None, conditions.inlet
    if conditions.inlet_is == "pressure":
        held += [(k, conditions.inlet) for k in inlets]
        flow = Constant(0.0)
    else:
        inflow = _supply(inlets, flow, coupled)
    return PortPlan(
        inflow,
        flow,
        tuple(held),
        tuple(coupled),
        outlets,
        conditions.profile == "womersley",
        conditions.viscosity_pa_s,
        conditions.density,
    )


def _supply(inlets: tuple[int, ...], flow: Waveform, coupled: list[CoupledPorts]) -> int | None:
    """One inlet has a profile; several hang on one supply and share its pressure."""
    if len(inlets) == 1:
        return inlets[0]
    coupled.append(CoupledPorts(inlets, GivenFlow(flow, -1.0)))
    return None


def _ends(
    mesh: LumenMesh, inlets: tuple[int, ...] | None, outlets: tuple[int, ...] | None
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Ports flow comes in by and leaves by: those of the nodes asked for, or as designed."""
    into = _asked(mesh, inlets, "inlet", True)
    out = _asked(mesh, outlets, "outlet", False)
    for ports, what in ((into, "inlet"), (out, "outlet")):
        if not ports:
            raise FlowError(f"the lumen's mesh has no {what}; open one, or name its node")
    both, bare = set(into) & set(out), set(range(len(mesh.ports))) - set(into) - set(out)
    if both or bare:
        port = min(both or bare)
        raise FlowError(
            f"port {port} (node {mesh.ports[port].node}) is {'both' if both else 'neither'} an "
            f"inlet {'and' if both else 'nor'} an outlet; name each end once"
        )
    return into, out


def _asked(
    mesh: LumenMesh, nodes: tuple[int, ...] | None, what: str, inlet: bool
) -> tuple[int, ...]:
    if nodes is None:
        return tuple(k for k, port in enumerate(mesh.ports) if port.inlet == inlet)
    place = {port.node: k for k, port in enumerate(mesh.ports)}
    _check_nodes(nodes, place, what)
    return tuple(sorted({place[n] for n in nodes}))


def _check_nodes(nodes: object, place: Mapping[int, int], what: str) -> None:
    strangers = sorted(set(nodes) - set(place))  # type: ignore[call-overload]
    if strangers:
        raise FlowError(f"{what}: node {strangers[0]} isn't at a port of the lumen's mesh")


def _outlets(
    mesh: LumenMesh, ports: tuple[int, ...], given: Outlet | Mapping[int, Outlet]
) -> list[tuple[int, Outlet]]:
    if not isinstance(given, Mapping):
        return [(k, given) for k in ports]
    _check_nodes(given, {mesh.ports[k].node: k for k in ports}, "outlet")
    bare = [mesh.ports[k].node for k in ports if mesh.ports[k].node not in given]
    if bare:
        raise FlowError(
            f"outlet {bare[0]} has no condition ({len(bare)} of {len(ports)} such); give it a "
            "pressure, a resistance or a Windkessel"
        )
    return [(k, given[mesh.ports[k].node]) for k in ports]
