"""Solve pulsatile 3D flow in a lumen by time steps until the cycle repeats.

Second-order backward differences, (3 u' - 4 u + u⁻)/(2 Δt), with convection implicit: Newton from
the extrapolation 3 (u - u⁻) + u⁼ takes a step or two, each by Krylov steps with one factor of the
symmetric part for all times. Explicit convection would bind the step to ν/u², a few 10⁻⁴ s here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from design.errors import FlowError
from design.hemodynamics.conditions import PulsatileConditions, ResistanceOutlet, WindkesselOutlet
from design.hemodynamics.three_d.engine import (
    CURVED,
    FlowOptions,
    check_memory,
    engine_mesh,
    running_engine,
)
from design.hemodynamics.three_d.meshing.lumen_mesh import LumenMesh
from design.hemodynamics.three_d.newton import (
    Apply,
    BorderedSolver,
    Convection,
    FlowProblem,
    Guide,
    Spaces,
    Stokes,
    matrix_operator,
    newton,
    on_velocity,
    solve_newton,
    spaces,
)
from design.hemodynamics.three_d.ports import (
    CoupledPorts,
    GivenFlow,
    Inflow,
    PortPlan,
    inflow_of,
    pulsatile_plan,
)
from design.hemodynamics.three_d.solution import ThreeDWaves, field_of, port_pressures
from design.hemodynamics.three_d.steady import check_laminar, columns_of, steady_problem
from design.hemodynamics.three_d.vessels.sections import Section
from design.hemodynamics.waveforms import common_period, cycle_times
from kernels.arrays import FloatArray

_TOLERANCE: Final = 1e-5
"""Residual that a time step leaves, over that of no flow; changes of cycles below a tenth of it
are its rounding."""
_ZERO_J2: Final = 5.135622
"""First zero of the Bessel function J₂."""
_START: Final = 0.01
"""Least share of a flow's swing that a start leaves in the velocity: for periods of 1 to 20 ms in a
pipe of 0.5 mm it gives 19 to 3 cycles, where 30 to 6 were needed."""


def march_flow(
    mesh: LumenMesh,
    conditions: PulsatileConditions,
    options: FlowOptions | None = None,
    stepping: Stepping | None = None,
    sections: Sequence[Section] = (),
) -> ThreeDWaves:
    """Step pulsatile flow from the steady one at mean flow until a cycle ends as it began.

    The wall is rigid. Windkessels begin with the periodic pressure of the steady flow's division.

    Parameters
    ----------
    mesh : LumenMesh
    conditions : PulsatileConditions
    options : FlowOptions, optional
        Its density isn't used: the conditions have one.
    stepping : Stepping, optional
    sections : sequence of Section
        Where flow and pressure are recorded at every step.

    Raises
    ------
    FlowError
        As `solve_steady`, waveforms of different periods, and where no periodic state is reached
        in so many cycles (before the solve where viscosity alone rules it out).
    """
    how, clock = options or FlowOptions(), stepping or Stepping()
    plan = pulsatile_plan(mesh, conditions)
    check_memory(mesh, how)
    period = common_period(plan.waveforms())
    if period is None:
        raise FlowError("nothing changes in time: all waveforms are constant; solve_steady does it")
    check_laminar(mesh, plan, plan.flow.at(cycle_times(period, clock.steps)), plan.inflow)
    check_cycles(max(port.radius_mm for port in mesh.ports), conditions, clock)
    with running_engine() as ng:
        room = spaces(ng, engine_mesh(ng, mesh), len(mesh.ports), how.order, plan.inflow)
        first = steady_problem(room, mesh, plan, how)
        begun = solve_newton(first).unknowns
        inflow = inflow_of(room, mesh, plan, period, clock.steps)
        del first
        stepper = _Stepper(room, plan, how, inflow, period / clock.steps, begun)
        mean_flow = stepper.problem.border.columns.T @ begun[: room.count]
        stepper.laws.start_periodic(np.outer(mean_flow, _drive(plan, period, clock.steps)))
        return _cycles(stepper, mesh, clock, period, sections)


def check_cycles(widest_mm: float, conditions: PulsatileConditions, clock: Stepping) -> None:
    """Refuse a given flow whose start viscosity can't damp out in so few cycles.

    What steady flow in a pipe of radius r leaves decays with exp(-ν z² t/r²), z the first zero of
    J₂ (Womersley 1955's equation without a flow); ``widest_mm`` is the widest radius known.

    Raises
    ------
    FlowError
    """
    period_s = conditions.inlet.period_s
    if period_s is None or conditions.inlet_is == "pressure":
        return
    flow = conditions.inlet.at(cycle_times(period_s, clock.steps))
    decay = conditions.viscosity_pa_s / conditions.density * (_ZERO_J2 / widest_mm) ** 2 * period_s
    change = _START * float(np.ptp(flow) / np.abs(flow).max(initial=1e-300)) * -np.expm1(-decay)
    needed = np.ceil(np.log(max(change / clock.tolerance, 1.0)) / decay)
    if needed > clock.cycles:
        raise FlowError(
            f"no periodic state in {clock.cycles} cycles of {period_s:g} s: in a lumen of radius "
            f"{widest_mm:g} mm a start decays by {-np.expm1(-decay):.2g} in a cycle, and takes "
            f"more than {needed:.0f} to {clock.tolerance:.1g}; allow more (three_d.most_cycles)"
        )


class _Stepper:
    """Operators of all time steps, and the last states."""

    def __init__(
        self,
        room: Spaces,
        plan: PortPlan,
        how: FlowOptions,
        inflow: Inflow,
        step_s: float,
        begun: FloatArray,
    ) -> None:
        self.room, self.plan, self.inflow, self.step_s = room, plan, inflow, step_s
        stokes = Stokes(room, plan.viscosity_pa_s, 1.5 * plan.density / step_s)
        self.laws = OutletLaws(plan.coupled, step_s, begun[room.count :])
        border = BorderedSolver(stokes.solve, columns_of(room, plan), self.laws.slope, room.free)
        convection = Convection(room, plan.density, plan.outlets) if how.convection else None
        nothing = np.zeros(room.count)
        self.problem = FlowProblem(
            room, stokes, convection, border, nothing, nothing, np.zeros(len(plan.coupled))
        )
        self.guide = Guide(self.problem, lazy=True)
        self.mass = _mass(room, plan.density / step_s)
        self.now = self.before = self.earlier = begun
        still = np.concatenate([inflow.at(0.0), np.zeros(len(plan.coupled))])
        self.scale = max(float(np.linalg.norm(self.problem.residual(begun, 0.0))),
                         float(np.linalg.norm(self.problem.residual(still, 0.0))))  # fmt: skip

    def advance(self, time_s: float) -> None:
        """Step to this time."""
        room, count = self.room, self.room.count
        load = self.mass(2.0 * self.now[:count] - 0.5 * self.before[:count])
        for port, waveform in self.plan.held:
            load -= float(waveform.at(np.array([time_s]))[0]) * room.outward[port]
        problem = replace(self.problem, load=load, given=self.laws.given(time_s))
        guess = 3.0 * (self.now - self.before) + self.earlier
        guess[:count] = np.where(room.free, guess[:count], self.inflow.at(time_s))
        share = 0.0 if problem.convection is None else 1.0
        limit = _TOLERANCE * self.scale
        solution = newton(problem, guess, share, limit, self.scale, self.guide)
        self.earlier, self.before, self.now = self.before, self.now, solution.unknowns
        self.laws.keep(problem.border.columns.T @ self.now[:count])


def _mass(room: Spaces, factor: float) -> Apply:
    """Return factor ∫ u·v as a function of the unknowns."""
    u, v = room.velocity.TnT()
    form = room.ng.BilinearForm(room.velocity, symmetric=True)
    form += factor * u * v * room.ng.dx(bonus_intorder=CURVED)
    form.Assemble()
    state, answer = form.mat.CreateColVector(), form.mat.CreateColVector()
    applied = on_velocity(matrix_operator(form.mat, state, answer), room.velocity.ndof)
    applied.form = form  # type: ignore[attr-defined]  # keeps the matrix alive
    return applied


def _cycles(
    stepper: _Stepper, mesh: LumenMesh, clock: Stepping, period: float, sections: Sequence[Section]
) -> ThreeDWaves:
    changes: list[float] = []
    begins, ends = list[FloatArray](), list[FloatArray]()
    for _ in range(clock.cycles):
        begins.append(stepper.laws.stored())
        record = _Record(stepper.room, mesh, clock, sections)
        begin = stepper.now
        for k in range(clock.steps):
            stepper.advance((k + 1) * stepper.step_s)
            record.keep((k + 1) % clock.steps, stepper.now[: stepper.room.count])
        changes.append(_change(stepper, begin))
        if changes[-1] <= clock.tolerance:
            times = cycle_times(period, clock.steps)
            flow, pressure = record.through
            return ThreeDWaves(
                times, record.flow, record.pressure, flow, pressure, np.array(changes)
            )
        ends.append(stepper.laws.stored())
        stepper.laws.shift(_extrapolated(begins, ends, clock.tolerance) - ends[-1])
    raise FlowError(
        f"no periodic state after {len(changes)} cycles: the last still changed by "
        f"{changes[-1]:.2g} of the largest value ({clock.tolerance:.1g} wanted); allow more cycles "
        "(three_d.most_cycles)"
    )


def _drive(plan: PortPlan, period_s: float, steps: int) -> FloatArray:
    """Return the given flow over a cycle, over its mean, (steps,); 1 where none is given."""
    flow = plan.flow
    for group in plan.coupled:
        if isinstance(group.law, GivenFlow) and group.law.factor < 0.0:
            flow = group.law.waveform
    values = flow.at(cycle_times(period_s, steps))
    return np.asarray(values / values.mean()) if values.mean() else np.ones(steps)


def _extrapolated(begins: list[FloatArray], ends: list[FloatArray], tolerance: float) -> FloatArray:
    """Extrapolate the cycles' changes to Windkessel pressures (m,), Pa, that repeat.

    A secant step for all Windkessels at once (Anderson 1965, doi 10.1145/321296.321305). Without
    it an error at the start decays by exp(-T/RC) in a cycle.
    """
    count = int(np.count_nonzero(np.any(ends, axis=0))) + 1
    end = np.array(ends[-count:])
    change = end - np.array(begins[-count:])
    if np.abs(change[-1]).max(initial=0.0) <= tolerance * np.abs(end).max(initial=0.0):
        return ends[-1]
    weight = np.linalg.lstsq((change[:-1] - change[-1]).T, change[-1], rcond=0.1 * _TOLERANCE)[0]
    return np.asarray(end[-1] - weight @ (end[:-1] - end[-1]))


def _change(stepper: _Stepper, begin: FloatArray) -> float:
    """Largest change of velocity and of pressure, each of its own largest value."""
    velocity, count = stepper.room.velocity.ndof, stepper.room.count
    parts = (slice(0, velocity), slice(velocity, count), slice(count, None))
    change = 0.0
    for part in parts:
        new, old = stepper.now[part], begin[part]
        largest = float(np.abs(new).max(initial=0.0))
        if largest > 0.0:
            change = max(change, float(np.abs(new - old).max()) / largest)
    return change


@dataclass(frozen=True)
class Stepping:
    """Time stepping options of pulsatile 3D flow.

    Attributes
    ----------
    steps : int
        In a cycle.
    cycles : int
        At most.
    tolerance : float
        Largest change from a cycle's begin to its end, over the largest value, of a periodic state.
    """

    steps: int = 50
    cycles: int = 20
    tolerance: float = 1e-4

    def __post_init__(self) -> None:
        if self.steps < 8 or self.cycles < 1:
            raise FlowError(
                f"{self.steps} steps in each of {self.cycles} cycles; take 8 steps and 1 cycle, "
                "or more"
            )


class _Record:
    """Flow and pressure at ports and sections over one cycle."""

    def __init__(
        self, room: Spaces, mesh: LumenMesh, clock: Stepping, sections: Sequence[Section]
    ) -> None:
        self.room, self.mesh, self.sections = room, mesh, sections
        ports, steps = len(mesh.ports), clock.steps
        self.flow, self.pressure = np.empty((ports, steps)), np.empty((ports, steps))
        self.through = np.empty((2, len(sections), steps))

    def keep(self, k: int, unknowns: FloatArray) -> None:
        """Take unknowns (n,) as those of step k."""
        room = self.room
        self.flow[:, k] = room.outward @ unknowns
        self.pressure[:, k] = port_pressures(room, unknowns)
        if not self.sections:
            return
        field = field_of(room, self.mesh, unknowns)
        for s, section in enumerate(self.sections):
            self.through[:, s, k] = section.flow(field), section.mean_pressure(field)


class OutletLaws:
    """Laws of all coupled groups, Q - D p = s, and the Windkessels' inner pressures.

    A Windkessel's inner pressure obeys C ṗ_c = Q - (p_c - p_d)/R_d, and p = R_p Q + p_c. By
    second-order backward differences it is a resistance in each step, p = Z Q + h, which is solved
    with the flow: stable whatever the step (Esmaily Moghadam, Vignon-Clementel, Figliola & Marsden
    2013, doi 10.1016/j.jcp.2012.07.035).

    Attributes
    ----------
    slope : (m,) float64, µL/(Pa·s)
        D, the same at all times.
    """

    def __init__(
        self, coupled: tuple[CoupledPorts, ...], step_s: float, pressure: FloatArray
    ) -> None:
        """Begin in steady flow with these pressures (m,) at the groups."""
        self._laws, self._step_s = [c.law for c in coupled], step_s
        self.slope = np.array([self._slope(law) for law in self._laws]).reshape(-1)
        self._now = np.zeros(len(coupled))
        for k, law in enumerate(self._laws):
            if isinstance(law, WindkesselOutlet):
                share = law.distal / (law.proximal + law.distal)
                self._now[k] = law.distal_pa + share * (pressure[k] - law.distal_pa)
        self._before = self._now

    def given(self, time_s: float) -> FloatArray:
        """Return s (m,) at the time stepped to, µL/s."""
        sources = np.zeros(len(self._laws))
        for k, law in enumerate(self._laws):
            if isinstance(law, GivenFlow):
                sources[k] = law.factor * float(law.waveform.at(np.array([time_s]))[0])
            elif isinstance(law, ResistanceOutlet):
                sources[k] = -law.distal_pa / law.resistance
            else:
                sources[k] = -self.slope[k] * self._inner(k, law, 0.0)
        return sources

    def keep(self, flow: FloatArray) -> None:
        """Take the step with this flow (m,), µL/s."""
        new = self._now.copy()
        for k, law in enumerate(self._laws):
            if isinstance(law, WindkesselOutlet):
                new[k] = self._inner(k, law, float(flow[k]))
        self._before, self._now = self._now, new

    def start_periodic(self, flow: FloatArray) -> None:
        """Begin with the Windkessels' periodic pressures at a cycle's flows (m, steps).

        Each harmonic by the steps' own backward differences.
        """
        steps = flow.shape[1]
        turn = np.exp(-2j * np.pi * np.arange(steps // 2 + 1) / steps)
        rate = (1.5 - 2.0 * turn + 0.5 * turn**2) / self._step_s
        self._now, self._before = self._now.copy(), self._before.copy()
        for k, law in enumerate(self._laws):
            if isinstance(law, WindkesselOutlet):
                above = np.fft.rfft(flow[k]) / (law.compliance * rate + 1.0 / law.distal)
                pressure = law.distal_pa + np.fft.irfft(above, steps)
                self._now[k], self._before[k] = pressure[0], pressure[-1]

    def stored(self) -> FloatArray:
        """Return the pressure in the Windkessels (m,), Pa; 0 for other laws."""
        return self._now.copy()

    def shift(self, pressure: FloatArray) -> None:
        """Add to the pressure in the Windkessels (m,), Pa."""
        self._now, self._before = self._now + pressure, self._before + pressure

    def _slope(self, law: GivenFlow | ResistanceOutlet | WindkesselOutlet) -> float:
        if isinstance(law, GivenFlow):
            return 0.0
        if isinstance(law, ResistanceOutlet):
            return 1.0 / law.resistance
        return 1.0 / (law.proximal + 1.0 / self._leak(law))

    def _leak(self, law: WindkesselOutlet) -> float:
        return 1.5 * law.compliance / self._step_s + 1.0 / law.distal

    def _inner(self, k: int, law: WindkesselOutlet, flow: float) -> float:
        """Pressure behind the first resistance, Pa."""
        held = law.compliance * (2.0 * self._now[k] - 0.5 * self._before[k]) / self._step_s
        return (flow + law.distal_pa / law.distal + held) / self._leak(law)
