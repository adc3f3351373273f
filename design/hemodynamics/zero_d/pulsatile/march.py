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
from design.hemodynamics.zero_d.nodal.conductance import NodalSystem, structure_of
from design.hemodynamics.zero_d.pulsatile.circuit import Circuit
from design.hemodynamics.zero_d.pulsatile.ladder import Ladder, ladder_of
from design.network import FloatArray

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

    def __init__(self, circuit: Circuit, ladder: Ladder, step_s: float, rho: float) -> None:
        alpha_m, self.alpha_f = (3.0 - rho) / (2.0 + 2.0 * rho), 1.0 / (1.0 + rho)
        self.gamma = 0.5 + alpha_m - self.alpha_f
        self.kappa = alpha_m / (self.gamma * self.alpha_f * step_s)
        self.lag = alpha_m - self.alpha_f
        self.beta = 1.0 - alpha_m / self.gamma
        self.step_s, self.ladder = step_s, ladder
        self.held = np.zeros(len(ladder.stored), dtype=bool)
        self.held[: circuit.node_count] = circuit.held
        self.conductance = 1.0 / (ladder.resistance + self.kappa * ladder.inertance)
        self.pulled = self.conductance * ladder.inertance
        self.heavy = bool(self.pulled.any())
        self.system: NodalSystem = structure_of(ladder.ends, self.held).factorise(
            self.conductance, self.kappa * ladder.stored
        )

    def advance(self, old: _State, driven: FloatArray, driven_next: FloatArray) -> _State:
        """One step; ``driven`` (n,) are given pressures and flows at its begin and end."""
        count, first, last = len(old.pressure), *self.ladder.ends.T
        drive = driven + self.alpha_f * (driven_next - driven)
        source = np.where(self.held, 0.0, drive)
        source += self.ladder.stored * (self.kappa * old.pressure - self.beta * old.rate)
        memory = self.pulled * (self.kappa * old.flow - self.beta * old.flow_rate)
        if self.heavy:
            source -= np.bincount(first, weights=memory, minlength=count)
            source += np.bincount(last, weights=memory, minlength=count)
        pressure, flow = self.system.solve(source, drive)
        flow += memory
        p = old.pressure + (pressure - old.pressure) / self.alpha_f
        p[self.held] = driven_next[self.held]
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
        no form in time.
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
    ladder = ladder_of(circuit)
    scheme = _Scheme(circuit, ladder, period / how.steps, how.spectral_radius)
    drives = _drives(circuit, len(ladder.stored), times)
    state = _steady(circuit, ladder, scheme, drives[:-1].mean(axis=0))
    record = _Record(circuit, ladder, how.steps)
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


def _drives(circuit: Circuit, count: int, times: FloatArray) -> FloatArray:
    """What drives each node at each time, (t, n)."""
    samples = np.array([w.at(times) for w in circuit.waveforms])
    found = np.zeros((len(times), count))
    on = np.flatnonzero(circuit.drive >= 0)
    found[:, on] = samples[circuit.drive[on]].T
    return found


def _steady(circuit: Circuit, ladder: Ladder, scheme: _Scheme, drive: FloatArray) -> _State:
    """The state in which nothing changes; a branch without resistance takes all that comes."""
    resistance = ladder.resistance
    least = resistance[resistance > 0.0].min(initial=1.0)
    conductance = 1.0 / np.where(resistance > 0.0, resistance, 1e-9 * least)
    system = structure_of(ladder.ends, scheme.held).factorise(conductance)
    pressure, flow = system.balanced(np.where(scheme.held, 0.0, drive), drive)
    still = np.zeros_like(pressure)
    return _State(pressure, still, still, flow, np.zeros_like(flow))


class _Record:
    """One cycle of what a user asks for."""

    def __init__(self, circuit: Circuit, ladder: Ladder, steps: int) -> None:
        self.circuit, self.ladder = circuit, ladder
        self.pressure = np.empty((steps + 1, circuit.node_count))
        self.first, self.last = (np.empty((steps + 1, len(ladder.into))) for _ in range(2))
        self.stores = bool(ladder.at_first.any() or ladder.at_last.any())

    def keep(self, k: int, state: _State) -> None:
        ladder, circuit = self.ladder, self.circuit
        self.pressure[k] = state.pressure[: circuit.node_count]
        self.first[k], self.last[k] = state.flow[ladder.into], state.flow[ladder.out]
        if self.stores:
            self.first[k] += ladder.at_first * state.rate_here[circuit.first]
            self.last[k] -= ladder.at_last * state.rate_here[circuit.last]

    def change(self) -> float:
        worst = 0.0
        for kept in (self.pressure, self.first, self.last):
            largest = float(max(kept.max(), -kept.min()))
            if largest > 0.0:
                worst = max(worst, float(np.abs(kept[-1] - kept[0]).max()) / largest)
        return worst

    def arrays(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        return self.pressure, self.first, self.last
