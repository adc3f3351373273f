"""Time-step a circuit by the generalised-α method, with one factorisation for all steps.

For C ṗ + Σ Q = s at nodes and L Q̇ + R Q = Δp in branches, Jansen, Whiting & Hulbert 2000, doi
10.1016/S0045-7825(00)00203-6, with ρ the spectral radius at infinite steps:

    α_m = (3 - ρ)/(2 (1 + ρ)),  α_f = 1/(1 + ρ),  γ = ½ + α_m - α_f.

With κ = α_m/(γ α_f Δt) and β = 1 - α_m/γ, values at t + α_f Δt obey

    Q_f = (Δp_f + L (κ Q_n - β Q̇_n)) / (R + κ L),  κ C p_f + Σ Q_f = s_f + C (κ p_n - β ṗ_n),

the steady problem with conductances 1/(R + κ L) and κ C to ground: of second order, and as cheap
as steady flow in each step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.hemodynamics.waveforms.waveform import common_period, cycle_times
from design.hemodynamics.zero_d.nodal.conductance import NodalSystem
from design.hemodynamics.zero_d.pulsatile.circuit import Circuit
from kernels.arrays import FloatArray

PERIODIC = 1e-6
"""Largest change from cycle to cycle, relative to the largest value, of a periodic state."""


@dataclass(frozen=True)
class MarchOptions:
    """Time stepping options of the circuit solver.

    Attributes
    ----------
    steps : int
        In a cycle.
    cycles : int
        At most.
    tolerance : float or None
        Stop when a cycle ends as it began, to this part of the largest pressure and flow; None
        to go through all cycles.
    spectral_radius : float
        ρ of the method, 0 (damps what a step can't resolve at once) to 1 (never).
    """

    steps: int = 100
    cycles: int = 50
    tolerance: float | None = PERIODIC
    spectral_radius: float = 0.5

    def __post_init__(self) -> None:
        if not 0.0 <= self.spectral_radius <= 1.0:
            raise FlowError(f"spectral radius {self.spectral_radius:g} isn't between 0 and 1")
        if self.steps < 3 or self.cycles < 1:
            raise FlowError(
                f"{self.steps} steps in each of {self.cycles} cycles; take 3 steps and 1 cycle or "
                "more"
            )


@dataclass(frozen=True)
class Marched:
    """Last cycle of a time-stepped circuit.

    Attributes
    ----------
    period_s : float, s
    time_s : (t,) float64, s
        From the cycle's begin to its end.
    pressure : (t, n) float64, Pa
    flow_first, flow_last : (t, b) float64, µL/s
        Into each branch at its first node and out of it at its last.
    change : (c,) float64
        From each cycle's begin to its end, relative to the largest value.
    periodic : bool
        Whether the last change is within the tolerance.
    """

    period_s: float
    time_s: FloatArray
    pressure: FloatArray
    flow_first: FloatArray
    flow_last: FloatArray
    change: FloatArray
    periodic: bool


@dataclass
class _State:
    pressure: FloatArray
    rate: FloatArray
    rate_here: FloatArray
    flow: FloatArray
    flow_rate: FloatArray


class _Scheme:
    """Factors and coefficients that hold for all steps."""

    def __init__(self, circuit: Circuit, step_s: float, rho: float) -> None:
        alpha_m, self.alpha_f = (3.0 - rho) / (2.0 + 2.0 * rho), 1.0 / (1.0 + rho)
        self.gamma = 0.5 + alpha_m - self.alpha_f
        self.kappa = alpha_m / (self.gamma * self.alpha_f * step_s)
        self.lag = alpha_m - self.alpha_f
        self.beta = 1.0 - alpha_m / self.gamma
        self.step_s, self.circuit, self.stored = step_s, circuit, _stored(circuit)
        self.conductance = 1.0 / (circuit.resistance + self.kappa * circuit.inertance)
        self.pulled = self.conductance * circuit.inertance
        self.heavy = bool(self.pulled.any())
        self.system: NodalSystem = circuit.structure().factorise(
            self.conductance, self.kappa * self.stored
        )

    def advance(self, old: _State, driven: FloatArray, driven_next: FloatArray) -> _State:
        """One step; ``driven`` (n,) are given pressures and flows at its begin and end."""
        circuit, count = self.circuit, len(old.pressure)
        drive = driven + self.alpha_f * (driven_next - driven)
        source = np.where(circuit.held, 0.0, drive)
        source += self.stored * (self.kappa * old.pressure - self.beta * old.rate)
        memory = self.pulled * (self.kappa * old.flow - self.beta * old.flow_rate)
        if self.heavy:
            source -= np.bincount(circuit.first, weights=memory, minlength=count)
            source += np.bincount(circuit.last, weights=memory, minlength=count)
        pressure, flow = self.system.solve(source, drive)
        flow += memory
        p = old.pressure + (pressure - old.pressure) / self.alpha_f
        p[circuit.held] = driven_next[circuit.held]
        q = old.flow + (flow - old.flow) / self.alpha_f
        rate = self._rate(p - old.pressure, old.rate)
        # The method's rates lag α_m - α_f of a step behind its values: of first order as they are.
        here = rate + self.lag * (rate - old.rate)
        return _State(p, rate, here, q, self._rate(q - old.flow, old.flow_rate))

    def _rate(self, change: FloatArray, rate: FloatArray) -> FloatArray:
        return rate + (change / self.step_s - rate) / self.gamma


def march(circuit: Circuit, options: MarchOptions | None = None) -> Marched:
    """Step from the steady state of the mean drive, until a cycle ends as it began.

    Raises
    ------
    FlowError
        Waveforms of different periods, pressure nowhere given, Womersley's impedance, which has
        no form in time, a branch with neither resistance nor inertance.
    """
    how = MarchOptions() if options is None else options
    if circuit.womersley is not None:
        raise FlowError(
            "Womersley's impedance is known by frequency; solve for the periodic state, or choose "
            "the poiseuille profile"
        )
    if not circuit.held.any():
        raise FlowError("no pressure is given anywhere, so none is determined; give an outlet one")
    period = common_period(circuit.waveforms) or 1.0
    times = cycle_times(period, how.steps, closed=True)
    _check_branches(circuit)
    scheme = _Scheme(circuit, period / how.steps, how.spectral_radius)
    drives = _drives(circuit, times)
    state = _steady(circuit, drives[:-1].mean(axis=0))
    record = _Record(circuit, how.steps)
    changes: list[float] = []
    for _ in range(how.cycles):
        record.keep(0, state)
        for k in range(how.steps):
            state = scheme.advance(state, drives[k], drives[k + 1])
            record.keep(k + 1, state)
        changes.append(record.change())
        if how.tolerance is not None and changes[-1] <= how.tolerance:
            break
    periodic = changes[-1] <= (PERIODIC if how.tolerance is None else how.tolerance)
    return Marched(period, times, *record.arrays(), np.array(changes), periodic)


def _check_branches(circuit: Circuit) -> None:
    bare = np.flatnonzero((circuit.resistance <= 0.0) & (circuit.inertance <= 0.0))
    if len(bare):
        raise FlowError(
            f"branch {int(bare[0])} has neither resistance nor inertance; join its nodes instead"
        )


def _stored(circuit: Circuit) -> FloatArray:
    """Capacitance at each node, with half of each branch's at either end, (n,)."""
    stored = circuit.stored.copy()
    for ends in (circuit.first, circuit.last):
        np.add.at(stored, ends, circuit.capacitance / 2.0)
    return stored


def _drives(circuit: Circuit, times: FloatArray) -> FloatArray:
    """What drives each node at each time, (t, n)."""
    samples = np.array([w.at(times) for w in circuit.waveforms])
    drives = np.zeros((len(times), circuit.node_count))
    on = np.flatnonzero(circuit.drive >= 0)
    drives[:, on] = samples[circuit.drive[on]].T
    return drives


def _steady(circuit: Circuit, drive: FloatArray) -> _State:
    """The state in which nothing changes; a branch without resistance takes all that comes."""
    resistance = circuit.resistance
    least = resistance[resistance > 0.0].min(initial=1.0)
    conductance = 1.0 / np.where(resistance > 0.0, resistance, 1e-9 * least)
    system = circuit.structure().factorise(conductance)
    pressure, flow = system.balanced(np.where(circuit.held, 0.0, drive), drive)
    still = np.zeros_like(pressure)
    return _State(pressure, still, still, flow, np.zeros_like(flow))


class _Record:
    """One cycle of what a user asks for."""

    def __init__(self, circuit: Circuit, steps: int) -> None:
        self.circuit, self.half = circuit, circuit.capacitance / 2.0
        self.pressure = np.empty((steps + 1, circuit.node_count))
        self.first, self.last = (np.empty((steps + 1, len(self.half))) for _ in range(2))
        self.stores = bool(self.half.any())

    def keep(self, k: int, state: _State) -> None:
        circuit = self.circuit
        self.pressure[k], self.first[k], self.last[k] = state.pressure, state.flow, state.flow
        if self.stores:
            self.first[k] += self.half * state.rate_here[circuit.first]
            self.last[k] -= self.half * state.rate_here[circuit.last]

    def change(self) -> float:
        worst = 0.0
        for kept in (self.pressure, self.first, self.last):
            largest = float(max(kept.max(), -kept.min()))
            if largest > 0.0:
                worst = max(worst, float(np.abs(kept[-1] - kept[0]).max()) / largest)
        return worst

    def arrays(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        return self.pressure, self.first, self.last
