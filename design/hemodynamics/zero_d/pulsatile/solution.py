"""Solve pulsatile 0D flow by harmonics; data class of the periodic state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics.waveforms import cycle_times
from design.hemodynamics.zero_d.pulsatile.build import build_circuit
from design.hemodynamics.zero_d.pulsatile.conditions import PulsatileConditions
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
    """

    period_s: float
    harmonic: NDArray[np.int64]
    pressure: ComplexArray
    flow_in: ComplexArray
    flow_out: ComplexArray

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


def _of_phasors(phasors: Phasors, slot: IntArray, vessels: int) -> PulsatileSolution:
    return PulsatileSolution(
        phasors.period_s,
        phasors.harmonic,
        phasors.pressure[:, slot],
        phasors.flow_first[:, :vessels],
        phasors.flow_last[:, :vessels],
    )


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
