"""Solve for a circuit's periodic state by frequency, one linear solve per harmonic.

The circuit is linear, so each harmonic of what drives it is answered by itself. Solving for the
answer gives the periodic state with no transient to wait for: a Windkessel whose time constant is
many cycles costs the same as none; a sine costs two solves however large the network; and an
impedance may depend on frequency, as Womersley's does. Each solve is the steady problem with
complex admittances: a tree is eliminated in O(n), what loops remain are factorised.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.hemodynamics.vessel_coefficients import impedance_factor
from design.hemodynamics.waveforms import common_period, harmonics_of
from design.hemodynamics.zero_d.nodal.conductance import Structure
from design.hemodynamics.zero_d.pulsatile.circuit import Circuit

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True)
class Phasors:
    """x(t) = Re Σ x_k exp(i ω_k t) with ω_k = 2π harmonic_k/period.

    Attributes
    ----------
    period_s : float, s
        1 where nothing changes.
    harmonic : (k,) int64
        The first is 0.
    pressure : (k, n) complex128, Pa
    flow_first, flow_last : (k, b) complex128, µL/s
        Into each branch at its first node and out of it at its last.
    series : (k, b) complex128, µL/s
        Through each branch's resistance and inertance (in the middle of a Π).
    """

    period_s: float
    harmonic: NDArray[np.int64]
    pressure: ComplexArray
    flow_first: ComplexArray
    flow_last: ComplexArray
    series: ComplexArray


def solve_periodic(circuit: Circuit, steps: int) -> Phasors:
    """Find the periodic state.

    Parameters
    ----------
    circuit : Circuit
    steps : int
        Of a cycle; harmonics as `harmonics_of` keeps them.

    Raises
    ------
    FlowError
        Waveforms of different periods, a branch without resistance, pressure nowhere given.
    """
    _check(circuit, steps)
    period = common_period(circuit.waveforms)
    harmonic, drives = harmonics_of(circuit.waveforms, period or 1.0, steps)
    structure = circuit.structure()
    size = (len(harmonic), len(circuit.first))
    pressure = np.empty((len(harmonic), circuit.node_count), dtype=np.complex128)
    first, last, series = (np.empty(size, dtype=np.complex128) for _ in range(3))
    for k, number in enumerate(harmonic):
        omega = 2.0 * np.pi * number / (period or 1.0)
        p, q, s0, s1 = _one(circuit, structure, omega, drives[:, k])
        pressure[k], series[k] = p, q
        first[k] = q + s0 * p[circuit.first]
        last[k] = q - s1 * p[circuit.last]
    return Phasors(period or 1.0, harmonic, pressure, first, last, series)


def impedance(circuit: Circuit, omega: float) -> ComplexArray:
    """Of each branch's resistance and inertance in series at ``omega`` rad/s, (b,)."""
    plain = circuit.resistance + 1j * omega * circuit.inertance
    if circuit.womersley is None:
        return plain
    pipe = circuit.resistance * impedance_factor(circuit.womersley * np.sqrt(omega))
    return np.where(circuit.womersley > 0.0, pipe, plain)


def admittances(circuit: Circuit, omega: float) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Each branch as a Π: along it, and to ground at its first and at its last node, (b,) each."""
    store = 1j * omega * circuit.capacitance
    along = impedance(circuit, omega)
    return _complex(1.0 / along), _complex(store / 2.0), _complex(store / 2.0)


def _complex(values: NDArray[Any]) -> ComplexArray:
    return np.asarray(values, dtype=np.complex128)


def _one(
    circuit: Circuit, structure: Structure, omega: float, drive: ComplexArray
) -> tuple[ComplexArray, ComplexArray, ComplexArray, ComplexArray]:
    series, s0, s1 = admittances(circuit, omega)
    ground = _complex(1j * omega * circuit.stored)
    for where, shunt in ((circuit.first, s0), (circuit.last, s1)):
        ground += 1j * np.bincount(where, weights=shunt.imag, minlength=len(ground))
        ground += np.bincount(where, weights=shunt.real, minlength=len(ground))
    driven = circuit.driven(drive)
    system = structure.factorise(series, ground)
    pressure, flow = system.balanced(np.where(circuit.held, 0.0, driven), driven)
    return pressure, flow, s0, s1


def _check(circuit: Circuit, steps: int) -> None:
    if steps < 3:
        raise FlowError(f"{steps} steps a cycle show no wave; take 3 or more, 100 are usual")
    if not circuit.held.any():
        raise FlowError(
            "no pressure is given anywhere, so none is determined; give an outlet a pressure, a "
            "resistance or a Windkessel"
        )
    bare = np.flatnonzero(~(circuit.resistance > 0.0))
    if len(bare):
        raise FlowError(
            f"branch {int(bare[0])} has no resistance, so that its mean flow has no bound; give "
            "it one, or step through time (march)"
        )
