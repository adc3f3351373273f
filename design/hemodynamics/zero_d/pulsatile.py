"""Solve periodic pulsatile 0D flow in a network by harmonics of its electrical-analogue circuit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.hemodynamics.conditions import (
    Outlet,
    PressureOutlet,
    PulsatileConditions,
    ResistanceOutlet,
    WindkesselOutlet,
    outlet_groups,
)
from design.hemodynamics.vessel_coefficients import (
    PARABOLIC,
    impedance_factor,
    plug_inertance,
    vessel_resistance,
    womersley_number,
)
from design.hemodynamics.waveforms import (
    Constant,
    Waveform,
    common_period,
    cycle_times,
    harmonics_of,
)
from design.hemodynamics.zero_d.boundary import (
    checked_ends,
    number_unknowns,
    supplied_inlets,
)
from design.hemodynamics.zero_d.nodal import Structure, structure_of
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray

ComplexArray = NDArray[np.complex128]

SAMPLES: Final = 200
"""Times in a cycle at which least and greatest values are looked for."""

_CHUNK: Final = 20_000
"""Columns sampled at once: 32 MB of them."""


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
    steps : int
        Of a cycle; harmonics that these resolve are kept.

    Raises
    ------
    FlowError
        As `build_circuit`; waveforms of different periods, a branch without resistance, pressure
        nowhere given.
    """
    circuit, slot = build_circuit(network, conditions)
    _check_circuit(circuit, steps)
    period = common_period(circuit.waveforms) or 1.0
    harmonic, drives = harmonics_of(circuit.waveforms, period, steps)
    structure = structure_of(np.column_stack([circuit.first, circuit.last]), circuit.fixed)
    pressure = np.empty((len(harmonic), len(circuit.stored)), dtype=np.complex128)
    flow_in, flow_out = np.empty((2, len(harmonic), len(circuit.first)), dtype=np.complex128)
    for k, number in enumerate(harmonic):
        omega = 2.0 * np.pi * number / period
        p, series, shunt = _one_harmonic(circuit, structure, omega, drives[:, k])
        pressure[k] = p
        flow_in[k] = series + shunt * p[circuit.first]
        flow_out[k] = series - shunt * p[circuit.last]
    vessels = network.vessel_count
    return PulsatileSolution(
        period, harmonic, pressure[:, slot], flow_in[:, :vessels], flow_out[:, :vessels]
    )


def cycle_extremes(
    solution: PulsatileSolution, phasors: ComplexArray
) -> tuple[FloatArray, FloatArray]:
    """Return the least and greatest value over a cycle of phasors (k, n), (n,) each."""
    low, high = reduce_cycle(
        solution, phasors, lambda values: np.stack([values.min(axis=0), values.max(axis=0)])
    )
    return low, high


def reduce_cycle(
    solution: PulsatileSolution,
    phasors: ComplexArray,
    reduce: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """Apply ``reduce`` to samples (t, n) of phasors (k, n), in parts that fit into memory."""
    times, count = solution.times(SAMPLES), phasors.shape[1]
    parts = [phasors[:, k : k + _CHUNK] for k in range(0, count, _CHUNK)]
    return np.concatenate([reduce(solution.at(part, times)) for part in parts], axis=-1)


@dataclass(frozen=True)
class Circuit:
    """Branches of resistance, inertance and capacitance between nodes.

    Attributes
    ----------
    first, last : (b,) int64
        Nodes of each branch; its flow is positive from first to last.
    resistance, inertance, capacitance : (b,) float64, Pa·s/µL, Pa·s²/µL, µL/Pa
        Half of a branch's capacitance sits at each end, which knows no direction and is of second
        order in the branch's length.
    stored : (n,) float64, µL/Pa
        Capacitance to ground at each node, beside what branches have.
    fixed : (n,) bool
        Nodes whose pressure is given.
    drive : (n,) int64
        Which waveform gives the pressure of a fixed node (Pa), or the flow into another (µL/s);
        -1 for no flow.
    waveforms : tuple of Waveform
    womersley : (b,) float64, √s, or None
        Womersley number at 1 rad/s, for branches whose impedance is Womersley's; 0 elsewhere.
    """

    first: IntArray
    last: IntArray
    resistance: FloatArray
    inertance: FloatArray
    capacitance: FloatArray
    stored: FloatArray
    fixed: NDArray[np.bool_]
    drive: IntArray
    waveforms: tuple[Waveform, ...]
    womersley: FloatArray | None = None


@dataclass
class _Additions:
    """Nodes and branches of a circuit beyond the network's own, and what drives it."""

    nodes: int
    driven: list[tuple[IntArray, Waveform, bool]] = field(default_factory=list)
    """Nodes, what drives them, and whether that is a pressure."""
    stored: list[tuple[IntArray, float]] = field(default_factory=list)
    branches: list[tuple[IntArray, IntArray, float]] = field(default_factory=list)

    def more_nodes(self, count: int) -> IntArray:
        self.nodes += count
        return np.arange(self.nodes - count, self.nodes)

    def attach(self, nodes: IntArray, outlet: Outlet) -> None:
        if isinstance(outlet, PressureOutlet):
            self.driven.append((nodes, outlet.waveform, True))
            return
        far = self.more_nodes(len(nodes))
        self.driven.append((far, Constant(outlet.distal_pa), True))
        if isinstance(outlet, ResistanceOutlet):
            self.branches.append((nodes, far, outlet.resistance))
        elif isinstance(outlet, WindkesselOutlet):
            middle = self.more_nodes(len(nodes))
            self.stored.append((middle, outlet.compliance))
            self.branches.append((nodes, middle, outlet.proximal))
            self.branches.append((middle, far, outlet.distal))


def build_circuit(
    network: VesselNetwork, conditions: PulsatileConditions
) -> tuple[Circuit, IntArray]:
    """Return the circuit, whose first branches are the vessels, and the node in it of each node.

    Raises
    ------
    FlowError
        No inlet, no outlet, an isolated part, an outlet without a condition, a vessel of zero
        length.
    """
    viscosity, density = conditions.viscosity_pa_s, conditions.density
    resistance = vessel_resistance(network, viscosity)
    inlets, outlets = checked_ends(network, conditions)
    slot = np.arange(len(network.nodes))
    common, own = supplied_inlets(inlets, conditions.supplies)
    for nodes in (*own, *([common] if conditions.inlet_is == "flow" else [])):
        slot[nodes] = nodes[0]
    (slot,) = number_unknowns(slot)
    more = _Additions(int(slot.max()) + 1)
    more.driven.append((slot[common], conditions.inlet, conditions.inlet_is == "pressure"))
    for nodes, supply in zip(own, conditions.supplies, strict=True):
        more.driven.append((slot[nodes], Constant(supply.flow_ul_s), False))
    for outlet, nodes in outlet_groups(conditions.outlet, outlets):
        more.attach(slot[nodes], outlet)
    stored, drive = np.zeros(more.nodes), np.full(more.nodes, -1)
    for nodes, amount in more.stored:
        stored[nodes] += amount
    fixed = np.zeros(more.nodes, dtype=bool)
    for k, (nodes, _, is_pressure) in enumerate(more.driven):
        drive[nodes], fixed[nodes] = k, is_pressure
    added = [np.full(len(first), r) for first, _, r in more.branches]
    none = np.zeros(sum(map(len, added)))
    inertance = PARABOLIC * plug_inertance(network, density)
    alpha = womersley_number(network.mean_radius(), 1.0, viscosity, density)
    first, last = slot[network.vessel_nodes].T
    circuit = Circuit(
        first=np.concatenate([first, *(nodes for nodes, _, _ in more.branches)]),
        last=np.concatenate([last, *(nodes for _, nodes, _ in more.branches)]),
        resistance=np.concatenate([resistance, *added]),
        inertance=np.concatenate([inertance, none]),
        capacitance=np.concatenate([conditions.wall.compliance(network), none]),
        stored=stored,
        fixed=fixed,
        drive=drive,
        waveforms=tuple(waveform for _, waveform, _ in more.driven),
        womersley=np.concatenate([alpha, none]) if conditions.profile == "womersley" else None,
    )
    return circuit, slot


def _one_harmonic(
    circuit: Circuit, structure: Structure, omega: float, drive: ComplexArray
) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Pressures (n,), flows through branches and admittance to ground at either end (b,).

    The circuit is linear, so each harmonic of what drives it is answered by itself. Solving for the
    answer gives the periodic state with no transient to wait for: a Windkessel whose time constant
    is many cycles costs the same as none; a sine costs two solves however large the network; and an
    impedance may depend on frequency, as Womersley's does. Each solve is the steady problem with
    complex admittances: a tree is eliminated in O(n), what loops remain are factorised.
    """
    shunt = np.asarray(1j * omega * circuit.capacitance / 2.0, dtype=np.complex128)
    along = np.asarray(1.0 / _impedance(circuit, omega), dtype=np.complex128)
    ground = np.asarray(1j * omega * circuit.stored, dtype=np.complex128)
    for where in (circuit.first, circuit.last):
        ground += 1j * np.bincount(where, weights=shunt.imag, minlength=len(ground))
        ground += np.bincount(where, weights=shunt.real, minlength=len(ground))
    driven = np.zeros(len(ground), drive.dtype)
    driven[circuit.drive >= 0] = drive[circuit.drive[circuit.drive >= 0]]
    system = structure.factorise(along, ground)
    pressure, flow = system.balanced(np.where(circuit.fixed, 0.0, driven), driven)
    return pressure, flow, shunt


def _impedance(circuit: Circuit, omega: float) -> ComplexArray:
    """Of each branch's resistance and inertance in series at ``omega`` rad/s, (b,)."""
    plain = circuit.resistance + 1j * omega * circuit.inertance
    if circuit.womersley is None:
        return plain
    pipe = circuit.resistance * impedance_factor(circuit.womersley * np.sqrt(omega))
    return np.where(circuit.womersley > 0.0, pipe, plain)


def _check_circuit(circuit: Circuit, steps: int) -> None:
    if steps < 3:
        raise FlowError(f"{steps} steps a cycle show no wave; take 3 or more, 100 are usual")
    if not circuit.fixed.any():
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
