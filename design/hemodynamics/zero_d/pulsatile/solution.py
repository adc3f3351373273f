"""Solve pulsatile 0D flow by harmonics or time steps; data class of the periodic state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.hemodynamics.waveforms.waveform import cycle_times
from design.hemodynamics.zero_d.pulsatile.build import build_circuit
from design.hemodynamics.zero_d.pulsatile.conditions import PulsatileConditions
from design.hemodynamics.zero_d.pulsatile.march import Marched, MarchOptions, march
from design.hemodynamics.zero_d.pulsatile.phasors import Phasors, solve_periodic
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray

ComplexArray = NDArray[np.complex128]

SAMPLES: Final = 200
"""Times in a cycle at which least and greatest values are looked for."""

_CHUNK: Final = 20_000


@dataclass(frozen=True)
class PulsatileSolution:
    """A periodic state by its harmonics, x(t) = Re Σ x_k exp(2π i harmonic_k t/period).

    Attributes
    ----------
    period_s : float, s
    harmonic : (k,) int64
        The first is 0, the mean.
    pressure : (k, m) complex128, Pa
        At the network's nodes.
    flow_in, flow_out : (k, v) complex128, µL/s
        Into each vessel at its first node, and out of it at its last.
    change : (c,) float64
        From each cycle's begin to its end, relative to the largest value; empty where the state
        was solved for.
    """

    period_s: float
    harmonic: NDArray[np.int64]
    pressure: ComplexArray
    flow_in: ComplexArray
    flow_out: ComplexArray
    change: FloatArray

    @property
    def omega(self) -> FloatArray:
        """Of each harmonic, (k,), rad/s."""
        return np.asarray(2.0 * np.pi * self.harmonic / self.period_s, dtype=np.float64)

    def at(self, phasors: ComplexArray, time_s: FloatArray) -> FloatArray:
        """Values (t, …) at times (t,) of phasors (k, …)."""
        turn = np.exp(1j * np.outer(np.atleast_1d(time_s), self.omega))
        return np.asarray(np.tensordot(turn, phasors, axes=(1, 0)).real)

    def times(self, count: int) -> FloatArray:
        """So many times over a cycle, its end left out, s."""
        return cycle_times(self.period_s, count)


def solve_pulsatile(
    network: VesselNetwork, conditions: PulsatileConditions, steps: int = 100
) -> PulsatileSolution:
    """Find the periodic state by solving for each harmonic of what drives the network.

    Exact for the linear model: no transient, no error of time steps.

    Parameters
    ----------
    network : VesselNetwork
    conditions : PulsatileConditions
    steps : int
        Of a cycle; harmonics that these resolve are kept.

    Raises
    ------
    FlowError
        As `build_circuit` and `solve_periodic`.
    """
    circuit, slot = build_circuit(network, conditions)
    return _of_phasors(solve_periodic(circuit, steps), slot, network.vessel_count)


def march_pulsatile(
    network: VesselNetwork, conditions: PulsatileConditions, options: MarchOptions | None = None
) -> PulsatileSolution:
    """Step through cycles until one ends as it began.

    Raises
    ------
    FlowError
        As `build_circuit` and `march`, and when no periodic state is reached.
    """
    circuit, slot = build_circuit(network, conditions)
    marched = march(circuit, options)
    if not marched.periodic:
        raise FlowError(
            f"no periodic state after {len(marched.change)} cycles: the last still changed by "
            f"{marched.change[-1]:.2g} of the largest value; allow more cycles, or solve for the "
            "periodic state"
        )
    return _of_march(marched, slot, network.vessel_count)


def _of_phasors(phasors: Phasors, slot: IntArray, vessels: int) -> PulsatileSolution:
    return PulsatileSolution(
        phasors.period_s,
        phasors.harmonic,
        phasors.pressure[:, slot],
        phasors.flow_first[:, :vessels],
        phasors.flow_last[:, :vessels],
        np.zeros(0),
    )


def _of_march(marched: Marched, slot: IntArray, vessels: int) -> PulsatileSolution:
    flow_in = _harmonics(marched.flow_first[:, :vessels])
    return PulsatileSolution(
        marched.period_s,
        np.arange(len(flow_in)),
        _harmonics(marched.pressure)[:, slot],
        flow_in,
        _harmonics(marched.flow_last[:, :vessels]),
        marched.change,
    )


def _harmonics(samples: FloatArray) -> ComplexArray:
    """Phasors (k, …) of samples (t + 1, …) over a cycle whose end repeats its begin."""
    steps = len(samples) - 1
    phasors = np.fft.rfft(samples[:-1], axis=0) / steps
    phasors[1:] *= 2.0
    return np.asarray(phasors[: (steps + 1) // 2])


def cycle_extremes(
    solution: PulsatileSolution, phasors: ComplexArray
) -> tuple[FloatArray, FloatArray]:
    """Least and greatest value over a cycle of phasors (k, n), (n,) each."""
    times = solution.times(SAMPLES)
    count = phasors.shape[1]
    low, high = np.empty(count), np.empty(count)
    for start in range(0, count, _CHUNK):
        part = slice(start, start + _CHUNK)
        values = solution.at(phasors[:, part], times)
        low[part], high[part] = values.min(axis=0), values.max(axis=0)
    return low, high
