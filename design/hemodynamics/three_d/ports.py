"""Conditions and velocity profiles at the ports of a 3D mesh, steady or pulsatile."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.hemodynamics.conditions import (
    FlowConditions,
    Outlet,
    PressureOutlet,
    PulsatileConditions,
    ResistanceOutlet,
    WindkesselOutlet,
)
from design.hemodynamics.three_d.engine import CURVED, WALL_NAME, port_name
from design.hemodynamics.three_d.meshing.lumen_mesh import LumenMesh
from design.hemodynamics.three_d.newton import Spaces
from design.hemodynamics.waveforms import Constant, Waveform, harmonics_of
from design.hemodynamics.zero_d.boundary import refuse_supplies
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class GivenFlow:
    """Flow out of the lumen, µL/s, by ports that share a pressure: a waveform times a factor."""

    waveform: Waveform
    factor: float = 1.0


Law = GivenFlow | ResistanceOutlet | WindkesselOutlet


@dataclass(frozen=True)
class CoupledPorts:
    """Ports of one unknown pressure, and the law between it and their flow."""

    ports: tuple[int, ...]
    law: Law


@dataclass(frozen=True)
class PortPlan:
    """Conditions of all ports."""

    inflow: int | None  # port with a velocity profile
    flow: Waveform  # into it, µL/s
    held: tuple[tuple[int, Waveform], ...]  # ports of given pressure, Pa
    coupled: tuple[CoupledPorts, ...]
    outlets: tuple[int, ...]  # as designed or given, whichever way flow goes
    womersley: bool  # a profile for each harmonic; else Poiseuille's
    viscosity_pa_s: float
    density: float  # Pa·s²/mm²

    def waveforms(self) -> tuple[Waveform, ...]:
        """Return all waveforms."""
        laws = [c.law.waveform for c in self.coupled if isinstance(c.law, GivenFlow)]
        return (self.flow, *(w for _, w in self.held), *laws)


def steady_plan(mesh: LumenMesh, conditions: FlowConditions, density: float) -> PortPlan:
    """Assign steady conditions to the ports.

    Raises
    ------
    FlowError
        No inlet, no outlet, an unknown node, pressure nowhere given.
    """
    refuse_supplies(conditions.supplies, "3D flow")
    ends = _ends(mesh, conditions.inlets, conditions.outlets)
    node_port = {mesh.ports[k].node: k for k in ends[1]}
    _check_nodes(conditions.outlet_flow_ul_s, node_port, "outlet_flow_ul_s")
    _check_nodes(conditions.behind, node_port, "behind")
    outlet: dict[int, Law | PressureOutlet] = {
        node_port[n]: GivenFlow(Constant(q)) for n, q in conditions.outlet_flow_ul_s.items()
    }
    for k in ends[1]:
        load = conditions.behind.get(mesh.ports[k].node)
        if load is not None and load.resistance > 0.0:
            outlet[k] = ResistanceOutlet(load.resistance, load.pressure_pa)
        elif k not in outlet:
            pressure = conditions.outlet_pressure_pa if load is None else load.pressure_pa
            outlet[k] = PressureOutlet(Constant(pressure))
    driven = conditions.inlet_pressure_pa
    inlet = Constant(driven if driven is not None else conditions.inlet_flow_ul_s or 0.0)
    fluid = conditions.viscosity_pa_s, density
    return _plan(ends, outlet, inlet, driven is not None, False, fluid)


def pulsatile_plan(mesh: LumenMesh, conditions: PulsatileConditions) -> PortPlan:
    """Assign pulsatile conditions to the ports; the wall is taken as rigid.

    Raises
    ------
    FlowError
        No inlet, no outlet, an unknown node, an outlet without a condition.
    """
    refuse_supplies(conditions.supplies, "3D flow")
    ends = _ends(mesh, conditions.inlets, conditions.outlets)
    outlet = _outlets(mesh, ends[1], conditions.outlet)
    by_pressure = conditions.inlet_is == "pressure"
    fluid = conditions.viscosity_pa_s, conditions.density
    womersley = conditions.profile == "womersley"
    return _plan(ends, outlet, conditions.inlet, by_pressure, womersley, fluid)


def _plan(
    ends: tuple[tuple[int, ...], tuple[int, ...]],
    outlet: Mapping[int, Law | PressureOutlet],
    inlet: Waveform,
    by_pressure: bool,
    womersley: bool,
    fluid: tuple[float, float],
) -> PortPlan:
    """Make the plan; one inlet of given flow has a profile, several share a pressure."""
    inlets, outlets = ends
    held = [(k, x.waveform) for k, x in outlet.items() if isinstance(x, PressureOutlet)]
    coupled = [
        CoupledPorts((k,), x) for k, x in outlet.items() if not isinstance(x, PressureOutlet)
    ]
    inflow, flow = None, inlet
    if by_pressure:
        held += [(k, inlet) for k in inlets]
        flow = Constant(0.0)
    elif len(inlets) == 1:
        inflow = inlets[0]
    else:
        coupled.append(CoupledPorts(inlets, GivenFlow(inlet, -1.0)))
    if not held and all(isinstance(c.law, GivenFlow) for c in coupled):
        raise FlowError(
            "every inlet and outlet has a flow, so no pressure is determined; give "
            "inlet_pressure_pa, or leave one outlet to outlet_pressure_pa"
        )
    return PortPlan(inflow, flow, tuple(held), tuple(coupled), outlets, womersley, *fluid)


def _ends(
    mesh: LumenMesh, inlets: tuple[int, ...] | None, outlets: tuple[int, ...] | None
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the inlets and the outlets: at the given nodes, or as designed."""
    into = _ports_at(mesh, inlets, "inlet", True)
    out = _ports_at(mesh, outlets, "outlet", False)
    for ports, what in ((into, "inlet"), (out, "outlet")):
        if not ports:
            raise FlowError(f"the lumen's mesh has no {what}; open one, or name its node")
    both, neither = set(into) & set(out), set(range(len(mesh.ports))) - set(into) - set(out)
    if both or neither:
        port = min(both or neither)
        raise FlowError(
            f"port {port} (node {mesh.ports[port].node}) is {'both' if both else 'neither'} an "
            f"inlet {'and' if both else 'nor'} an outlet; name each end once"
        )
    return into, out


def _ports_at(
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
) -> dict[int, Outlet]:
    if not isinstance(given, Mapping):
        return dict.fromkeys(ports, given)
    _check_nodes(given, {mesh.ports[k].node: k for k in ports}, "outlet")
    bare = [mesh.ports[k].node for k in ports if mesh.ports[k].node not in given]
    if bare:
        raise FlowError(
            f"outlet {bare[0]} has no condition ({len(bare)} of {len(ports)} such); give it a "
            "pressure, a resistance or a Windkessel"
        )
    return {k: given[mesh.ports[k].node] for k in ports}


def unit_profile(spaces: Spaces, mesh: LumenMesh, port: int, rate: complex = 0.0) -> NDArray[Any]:
    """Solve for a developed flow of 1 µL/s into the lumen by ``port``: unknowns (n,), 0 elsewhere.

    Steady developed flow obeys -Δψ = 1 with 0 at the rim (Poiseuille's parabola in a circle), an
    oscillation i ω ϱ/μ ψ - Δψ = 1 (Womersley's in a circle). Both are solved on the port's own
    faces, so that a scanned lumen's opening needn't be round. ``rate`` is i ω ϱ/μ, 1/mm².

    Raises
    ------
    FlowError
        A port without a face or without a node inside its rim.
    """
    ng, region = spaces.ng, spaces.mesh.Boundaries(port_name(port))
    scalar = ng.H1(spaces.mesh, order=spaces.order, complex=bool(rate))
    inside = scalar.GetDofs(region) & ~scalar.GetDofs(spaces.mesh.Boundaries(WALL_NAME))
    if not inside.NumSet():
        raise FlowError(
            f"port {port} (node {mesh.ports[port].node}) has no face or no node inside its rim, "
            "so that no profile fits; mesh it finer"
        )
    psi, test = scalar.TnT()
    at = ng.ds(port_name(port), bonus_intorder=CURVED)
    form = ng.BilinearForm(scalar, symmetric=True)
    form += (ng.Grad(psi).Trace() * ng.Grad(test).Trace() + rate * psi * test) * at
    form.Assemble()
    load = ng.LinearForm(scalar)
    load += test * at
    load.Assemble()
    answer = load.vec.CreateVector()
    answer.data = form.mat.Inverse(inside, inverse="sparsecholesky") * load.vec
    shape = answer.FV().NumPy()
    unknowns = np.zeros(spaces.count, dtype=shape.dtype)
    for axis in range(3):
        unknowns[axis * scalar.ndof : (axis + 1) * scalar.ndof] = (
            -mesh.ports[port].outward[axis] * shape
        )
    return np.asarray(unknowns / -(spaces.outward[port] @ unknowns))


@dataclass(frozen=True)
class Inflow:
    """Profiles and the harmonics that drive them: u(t) = Re Σ profile_k exp(i ω_k t)."""

    omega: FloatArray  # (k,), rad/s
    profile: NDArray[np.complex128]  # (k, n), with its harmonic's flow

    def at(self, time_s: float) -> FloatArray:
        """Return the given unknowns, (n,)."""
        return np.asarray((np.exp(1j * self.omega * time_s) @ self.profile).real)


def inflow_of(room: Spaces, mesh: LumenMesh, plan: PortPlan, period_s: float, steps: int) -> Inflow:
    """Make Womersley's profile for each harmonic of the inlet's flow, or Poiseuille's for all."""
    if plan.inflow is None:
        return Inflow(np.zeros(1), np.zeros((1, room.count), dtype=np.complex128))
    number, (phasor,) = harmonics_of([plan.flow], period_s, steps)
    omega: FloatArray = 2.0 * np.pi * number.astype(np.float64) / period_s
    steady = unit_profile(room, mesh, plan.inflow)
    per_omega = plan.density / plan.viscosity_pa_s if plan.womersley else 0.0
    shapes = [
        unit_profile(room, mesh, plan.inflow, 1j * w * per_omega) if w * per_omega else steady
        for w in omega
    ]
    return Inflow(omega, phasor[:, None] * np.array(shapes))
