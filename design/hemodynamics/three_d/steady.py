"""Solve steady Navier–Stokes or Stokes flow in a 3D lumen mesh."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from design.errors import FlowError
from design.hemodynamics.conditions import FlowConditions, PulsatileConditions, ResistanceOutlet
from design.hemodynamics.three_d.engine import (
    LAMINAR,
    FlowOptions,
    check_memory,
    engine_mesh,
    running_engine,
)
from design.hemodynamics.three_d.meshing.lumen_mesh import LumenMesh
from design.hemodynamics.three_d.newton import (
    BorderedSolver,
    Convection,
    FlowProblem,
    NewtonSolution,
    Spaces,
    Stokes,
    solve_newton,
    spaces,
)
from design.hemodynamics.three_d.ports import (
    CoupledPorts,
    GivenFlow,
    PortPlan,
    pulsatile_plan,
    steady_plan,
    unit_profile,
)
from design.hemodynamics.three_d.solution import (
    ThreeDSolution,
    energy_of,
    face_mean,
    field_of,
    port_pressures,
    shear_of_faces,
    wall_shear,
)
from design.hemodynamics.waveforms import Waveform, cycle_times
from kernels.arrays import FloatArray


def solve_steady(
    mesh: LumenMesh,
    conditions: FlowConditions | PulsatileConditions,
    options: FlowOptions | None = None,
) -> ThreeDSolution:
    """Solve steady Navier–Stokes or Stokes flow in a lumen.

    One inlet of given flow gets Poiseuille's profile of the port's own shape; several share a
    pressure. Other ports have a uniform traction.

    Parameters
    ----------
    mesh : LumenMesh
        With elements that are mapped one to one (`straighten_edges`).
    conditions : FlowConditions or PulsatileConditions
        Of pulsatile ones, the means.
    options : FlowOptions, optional

    Raises
    ------
    FlowError
        Conditions that leave the pressure undetermined, too little memory, a Reynolds number
        above `LAMINAR`, no convergence, the extra not installed.
    """
    how = FlowOptions() if options is None else options
    plan = plan_of(mesh, conditions, how)
    check_memory(mesh, how)
    check_laminar(mesh, plan, np.array([mean(plan.flow)]), plan.inflow)
    with running_engine() as ng:
        room = spaces(ng, engine_mesh(ng, mesh), len(mesh.ports), how.order, plan.inflow)
        problem = steady_problem(room, mesh, plan, how)
        solution = solve_newton(problem, _reynolds_scale(mesh, plan))
        return _solution(room, mesh, plan, solution)


def plan_of(
    mesh: LumenMesh, conditions: FlowConditions | PulsatileConditions, options: FlowOptions
) -> PortPlan:
    """Return the conditions of all ports."""
    if isinstance(conditions, PulsatileConditions):
        return pulsatile_plan(mesh, conditions)
    return steady_plan(mesh, conditions, options.density)


def steady_problem(
    room: Spaces, mesh: LumenMesh, plan: PortPlan, options: FlowOptions
) -> FlowProblem:
    """Set up the system of the mean conditions."""
    stokes = Stokes(room, plan.viscosity_pa_s)
    start = np.zeros(room.count)
    if plan.inflow is not None:
        start = mean(plan.flow) * unit_profile(room, mesh, plan.inflow)
    load = np.zeros(room.count)
    for port, waveform in plan.held:
        load -= mean(waveform) * room.outward[port]
    slope, given = mean_laws(plan.coupled)
    border = BorderedSolver(stokes.solve, columns_of(room, plan), slope, room.free)
    convection = Convection(room, plan.density, plan.outlets) if options.convection else None
    return FlowProblem(room, stokes, convection, border, start, load, given)


def columns_of(room: Spaces, plan: PortPlan) -> FloatArray:
    """Return the rows (n, m) of the flow out of each coupled group."""
    rows = [room.outward[list(c.ports)].sum(axis=0) for c in plan.coupled]
    return np.array(rows).reshape(-1, room.count).T


def mean_laws(coupled: tuple[CoupledPorts, ...]) -> tuple[FloatArray, FloatArray]:
    """D and s of Q - D p = s for each group in steady flow."""
    slope, given = np.zeros(len(coupled)), np.zeros(len(coupled))
    for k, group in enumerate(coupled):
        law = group.law
        if isinstance(law, GivenFlow):
            given[k] = law.factor * mean(law.waveform)
            continue
        whole = law.resistance if isinstance(law, ResistanceOutlet) else law.proximal + law.distal
        slope[k], given[k] = 1.0 / whole, -law.distal_pa / whole
    return slope, given


def mean(waveform: Waveform) -> float:
    """Return a cycle's mean."""
    if waveform.period_s is None:
        return float(waveform.at(np.zeros(1))[0])
    return float(waveform.at(cycle_times(waveform.period_s, 512)).mean())


def check_laminar(mesh: LumenMesh, plan: PortPlan, flow: FloatArray, port: int | None) -> None:
    """Refuse a flow (one or more values) that may be turbulent at a port.

    Raises
    ------
    FlowError
    """
    if port is None:
        return
    number = float(np.abs(reynolds(plan, float(np.abs(flow).max()), mesh.ports[port].radius_mm)))
    if number > LAMINAR:
        raise FlowError(
            f"Reynolds number {number:.0f} at port {port} (node {mesh.ports[port].node}, radius "
            f"{mesh.ports[port].radius_mm:g} mm) is above {LAMINAR:.0f}: no laminar flow to solve "
            "for; lower the flow, or widen the lumen"
        )


def reynolds(plan: PortPlan, flow: float, radius: float) -> float:
    """2 ϱ Q/(π μ r)."""
    return 2.0 * plan.density * flow / (np.pi * plan.viscosity_pa_s * radius)


def _reynolds_scale(mesh: LumenMesh, plan: PortPlan) -> float:
    if plan.inflow is None:
        return float("nan")
    return abs(reynolds(plan, mean(plan.flow), mesh.ports[plan.inflow].radius_mm))


def _solution(
    room: Spaces, mesh: LumenMesh, plan: PortPlan, solution: NewtonSolution
) -> ThreeDSolution:
    unknowns = solution.unknowns[: room.count]
    field = field_of(room, mesh, unknowns)
    flow = room.outward @ unknowns
    number = np.array(
        [abs(reynolds(plan, q, p.radius_mm)) for q, p in zip(flow, mesh.ports, strict=True)]
    )
    for port in np.flatnonzero(number > LAMINAR):
        check_laminar(mesh, plan, flow[port : port + 1], int(port))
    return ThreeDSolution(
        field=field,
        wall_shear=wall_shear(field, plan.viscosity_pa_s),
        port_flow=flow,
        port_pressure=port_pressures(room, unknowns),
        reynolds=number,
        energy=energy_of(room, plan, unknowns),
        unknowns=room.count,
        residual=solution.residual,
        krylov=solution.krylov,
        coefficients=unknowns,
    )


@dataclass(frozen=True)
class ErrorEstimate:
    """Differences between order 3 and order 2, which bound the error of order 3.

    Attributes
    ----------
    pressure : float
        Largest of the ports, of the largest difference between two ports.
    flow : float
        Largest of the ports, of what comes in.
    wall_shear : float
        Its mean over the wall's area, of the mean wall shear. A triangle counts by its mean: at
        single nodes order 2 is off by several times as much, to both sides.
    """

    pressure: float
    flow: float
    wall_shear: float


def estimate_error(
    mesh: LumenMesh,
    conditions: FlowConditions | PulsatileConditions,
    solution: ThreeDSolution,
    options: FlowOptions | None = None,
) -> ErrorEstimate:
    """Solve again with the other order, and compare.

    Order 2's error is much the larger of the two, so that the difference estimates it, and bounds
    order 3's. The error of the lumen's shape isn't in it: for that, compare two meshes.

    Raises
    ------
    FlowError
        As `solve_steady`.
    """
    other = 5 - solution.field.order
    again = solve_steady(mesh, conditions, replace(options or FlowOptions(), order=other))
    drop = float(np.ptp(solution.port_pressure)) or 1.0
    into = -float(solution.port_flow[solution.port_flow < 0.0].sum()) or 1.0
    _, area, shear = shear_of_faces(solution)
    mean, other_mean = face_mean(shear), face_mean(shear_of_faces(again)[2])
    return ErrorEstimate(
        float(np.abs(solution.port_pressure - again.port_pressure).max()) / drop,
        float(np.abs(solution.port_flow - again.port_flow).max()) / into,
        float(area @ np.abs(other_mean - mean)) / (float(area @ mean) or 1.0),
    )
