"""Report pulsatile 0D flow: table of vessels, summary, waves at ends and at probes."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics.conditions import FlowConditions, PulsatileConditions
from design.hemodynamics.pressure_drops import drops_of, heads_of, measure_pipes
from design.hemodynamics.probes import Probes, ProbeWaves
from design.hemodynamics.vessel_coefficients import (
    LIMITS,
    PARABOLIC,
    POWERS,
    impedance_factor,
    integrals,
    plug_inertance,
    shear_factor,
    vessel_resistance,
    wave_speed,
    womersley_number,
)
from design.hemodynamics.zero_d.boundary import boundary_nodes
from design.hemodynamics.zero_d.pulsatile import (
    ComplexArray,
    PulsatileSolution,
    cycle_extremes,
    reduce_cycle,
)
from design.hemodynamics.zero_d.report import (
    UW_PER_PA_UL_S,
    largest_imbalance,
    poiseuille_holds,
    vessel_columns,
)
from design.hemodynamics.zero_d.steady import FlowSolution
from design.network import VesselNetwork
from design.units import PA_PER_MMHG, UL_S_PER_ML_MIN
from kernels.arrays import FloatArray, IntArray

Table = dict[str, NDArray[np.generic]]


class Swing(NamedTuple):
    """Mean and extremes of a cycle, all (n,)."""

    mean: FloatArray
    low: FloatArray
    high: FloatArray

    @property
    def amplitude(self) -> FloatArray:
        """Half of what lies between least and greatest."""
        return np.asarray((self.high - self.low) / 2.0)


def pressure_columns(side: str, swing: Swing) -> Table:
    """Columns of the pressure at one side of each vessel, Pa and mmHg."""
    return {
        f"pressure_{side}_mean_pa": swing.mean,
        f"pressure_{side}_amplitude_pa": swing.amplitude,
        f"pressure_{side}_min_mmhg": swing.low / PA_PER_MMHG,
        f"pressure_{side}_mean_mmhg": swing.mean / PA_PER_MMHG,
        f"pressure_{side}_max_mmhg": swing.high / PA_PER_MMHG,
    }


def flow_columns(swing: Swing) -> Table:
    """Columns of each vessel's flow, µL/s and mL/min."""
    return {
        "flow_mean_ul_s": swing.mean,
        "flow_amplitude_ul_s": swing.amplitude,
        "flow_min_ul_s": swing.low,
        "flow_max_ul_s": swing.high,
        "flow_mean_ml_min": swing.mean / UL_S_PER_ML_MIN,
        "flow_amplitude_ml_min": swing.amplitude / UL_S_PER_ML_MIN,
    }


def shear_columns(swing: Swing, size: FloatArray) -> Table:
    """Columns of each vessel's wall shear, Pa; ``size`` is its mean magnitude, (v,).

    ``oscillating_shear`` is ½ (1 - |mean τ|/mean |τ|), 0 where the shear keeps its direction and
    ½ where it has none.
    """
    share = np.divide(np.abs(swing.mean), size, out=np.ones_like(size), where=size > 0.0)
    return {
        "wall_shear_mean_pa": swing.mean,
        "wall_shear_amplitude_pa": swing.amplitude,
        "wall_shear_min_pa": swing.low,
        "wall_shear_max_pa": swing.high,
        "oscillating_shear": np.maximum(0.0, (1.0 - share) / 2.0),
    }


def end_columns(
    time_s: FloatArray, inlet: tuple[FloatArray, FloatArray], outlet: tuple[FloatArray, FloatArray]
) -> dict[str, FloatArray]:
    """Waves at a network's ends from flow, µL/s, and mean pressure, Pa, of each side, (t,)."""
    waves: dict[str, FloatArray] = {"time_s": time_s}
    for name, (flow, pressure) in (("inlet", inlet), ("outlet", outlet)):
        waves[f"{name}_flow_ml_min"] = flow / UL_S_PER_ML_MIN
        waves[f"{name}_pressure_mmhg"] = pressure / PA_PER_MMHG
    return waves


def inlet_summary(waves: dict[str, FloatArray]) -> dict[str, float]:
    """Mean and amplitude of the flow, and mean pressure, of `end_columns`' inlets."""
    return {
        "inlet_flow_mean_ml_min": float(waves["inlet_flow_ml_min"].mean()),
        "inlet_flow_amplitude_ml_min": float(np.ptp(waves["inlet_flow_ml_min"]) / 2.0),
        "inlet_pressure_mean_mmhg": float(waves["inlet_pressure_mmhg"].mean()),
    }


def _swing(solution: PulsatileSolution, phasors: ComplexArray) -> Swing:
    return Swing(phasors[0].real, *cycle_extremes(solution, phasors))


def _pulse_numbers(
    network: VesselNetwork, solution: PulsatileSolution, conditions: PulsatileConditions
) -> dict[str, NDArray[Any]]:
    """Columns that say how a pulse goes through each vessel, (v,).

    Womersley numbers are of the fundamental frequency, 0 where nothing changes, Reynolds numbers
    of the greatest flow; the wave speed is infinite in a rigid vessel. ``wave_share`` is the length
    over the fundamental's wavelength; a lumped vessel needs it well below 1. ``quasi_steady`` has a
    Womersley number below 1: the profile stays a parabola in step with the pressure.
    ``poiseuille_holds`` is quasi-steady, laminar, and developed but for a tenth of the length.
    """
    radius, length = network.mean_radius(), network.lengths()
    omega = float(solution.omega[1:].min(initial=np.inf))
    omega = omega if np.isfinite(omega) else 0.0
    alpha = womersley_number(radius, omega, conditions.viscosity_pa_s, conditions.density)
    low, high = cycle_extremes(solution, _middle_flow(solution))
    peak = np.maximum(np.abs(low), np.abs(high))
    number = 2.0 * conditions.density * peak / (np.pi * radius * conditions.viscosity_pa_s)
    inertance = plug_inertance(network, conditions.density)
    speed = wave_speed(inertance, conditions.wall.compliance(network), length)
    steady = alpha < LIMITS.quasi_steady
    return {
        "reynolds_max": number,
        "womersley": alpha,
        "wave_speed_mm_s": speed,
        "wave_share": length * omega / (2.0 * np.pi * speed),
        "quasi_steady": steady.astype(np.int64),
        "poiseuille_holds": (steady & poiseuille_holds(network, number)).astype(np.int64),
    }


def _middle_flow(solution: PulsatileSolution) -> ComplexArray:
    return (solution.flow_in + solution.flow_out) / 2.0


def _shear_phasors(
    network: VesselNetwork, solution: PulsatileSolution, conditions: PulsatileConditions
) -> ComplexArray:
    """Phasors of the wall shear at the mean radius, (k, v), Pa, with Womersley's correction."""
    radius = network.mean_radius()
    shear = _middle_flow(solution) * (4.0 * conditions.viscosity_pa_s / (np.pi * radius**3))
    for k, omega in enumerate(solution.omega):
        alpha = womersley_number(radius, omega, conditions.viscosity_pa_s, conditions.density)
        shear[k] *= shear_factor(alpha)
    return shear


def pulsatile_table(
    network: VesselNetwork, solution: PulsatileSolution, conditions: PulsatileConditions
) -> Table:
    """Columns of a per-vessel table, each (v,).

    An amplitude is half of what lies between least and greatest. ``pressure_damping`` and
    ``flow_damping`` are amplitudes at the vessel's end over those at its begin (1 where nothing
    changes); see `shear_columns` for ``oscillating_shear``.
    """
    pressure = _swing(solution, solution.pressure)
    first, last = (Swing(*(x[nodes] for x in pressure)) for nodes in network.vessel_nodes.T)
    enters, leaves = (_swing(solution, x) for x in (solution.flow_in, solution.flow_out))
    shear = _shear_phasors(network, solution, conditions)
    size = reduce_cycle(solution, shear, lambda values: np.abs(values).mean(axis=0))
    return (
        vessel_columns(network)
        | pressure_columns("in", first)
        | pressure_columns("out", last)
        | flow_columns(_swing(solution, _middle_flow(solution)))
        | {
            "pressure_damping": _ratio(last.amplitude, first.amplitude),
            "flow_damping": _ratio(leaves.amplitude, enters.amplitude),
        }
        | shear_columns(_swing(solution, shear), size)
        | _pulse_numbers(network, solution, conditions)
    )


def _ratio(top: FloatArray, bottom: FloatArray) -> FloatArray:
    still = 1e-12 * float(bottom.max(initial=0.0))
    return np.divide(top, bottom, out=np.ones_like(top), where=bottom > still)


def end_waves(
    network: VesselNetwork,
    solution: PulsatileSolution,
    conditions: PulsatileConditions,
    count: int = 100,
) -> dict[str, FloatArray]:
    """Flow through inlets and outlets and their mean pressures, over one cycle, (count,)."""
    times, (net, _) = solution.times(count), _nodal(network, solution)

    def through(nodes: IntArray, sign: float) -> tuple[FloatArray, FloatArray]:
        flow = solution.at(sign * net[:, nodes].sum(axis=1), times)
        return flow, solution.at(solution.pressure[:, nodes].mean(axis=1), times)

    inlets, outlets = boundary_nodes(network, conditions)
    return end_columns(times, through(inlets, 1.0), through(outlets, -1.0))


def pulsatile_summary(
    network: VesselNetwork, solution: PulsatileSolution, conditions: PulsatileConditions
) -> dict[str, float]:
    """Totals, extremes and balances for `report.json`; keys name their units.

    ``mass_imbalance`` is the greatest net flow at an inner node over the flow through it, summed
    over harmonics. ``energy_imbalance`` holds the mean power that enters and leaves,
    Σ ½ Re p_k Q_k* over inlets and outlets, against what viscosity takes, Σ ½ Re Z_k |Q_k|²,
    relative to the latter.
    """
    numbers = _pulse_numbers(network, solution, conditions)
    low, high = cycle_extremes(solution, solution.pressure)
    inlets, outlets = boundary_nodes(network, conditions)
    ends = np.concatenate([inlets, outlets])
    net, through = _nodal(network, solution)
    shear_low, shear_high = cycle_extremes(solution, _shear_phasors(network, solution, conditions))
    power, lost = _mean_powers(network, solution, conditions, ends, net[:, ends])
    speed = numbers["wave_speed_mm_s"]
    pulse_in, pulse_out = ((high - low)[nodes].max() for nodes in (inlets, outlets))
    summary = {
        "period_s": solution.period_s,
        "harmonics": float(len(solution.harmonic) - 1),
        **inlet_summary(end_waves(network, solution, conditions)),
        "inlet_pulse_mmhg": float(pulse_in) / PA_PER_MMHG,
        "outlet_pulse_mmhg": float(pulse_out) / PA_PER_MMHG,
        "pressure_max_mmhg": float(high.max()) / PA_PER_MMHG,
        "wall_shear_peak_pa": float(np.maximum(np.abs(shear_low), np.abs(shear_high)).max()),
        "reynolds_max": float(numbers["reynolds_max"].max()),
        "womersley_max": float(numbers["womersley"].max()),
        "wave_share_max": float(numbers["wave_share"].max()),
        "quasi_steady_share": float(numbers["quasi_steady"].mean()),
        "poiseuille_holds_share": float(numbers["poiseuille_holds"].mean()),
        "dissipated_uw": lost * UW_PER_PA_UL_S,
        "mass_imbalance": largest_imbalance(np.abs(net).sum(axis=0), through.sum(axis=0), ends),
        "energy_imbalance": abs(power - lost) / lost if lost > 0.0 else 0.0,
    }
    if np.isfinite(speed).any():
        summary["wave_speed_min_mm_s"] = float(speed.min())
    return summary


def _mean_powers(
    network: VesselNetwork,
    solution: PulsatileSolution,
    conditions: PulsatileConditions,
    ends: IntArray,
    into: ComplexArray,
) -> tuple[float, float]:
    """Mean power of flows ``into`` (k, e) the ends, and what viscosity takes, Pa·µL/s."""
    weight = np.where(solution.harmonic == 0, 1.0, 0.5)[:, None]
    power = float((weight * (solution.pressure[:, ends] * into.conj()).real).sum())
    first = network.vessel_nodes[:, 0]
    resistance = vessel_resistance(network, conditions.viscosity_pa_s)
    half = conditions.wall.compliance(network) / 2.0
    lost = 0.0
    for k, omega in enumerate(solution.omega):
        series = solution.flow_in[k] - 1j * omega * half * solution.pressure[k, first]
        factor = np.ones(len(first))
        if conditions.profile == "womersley":
            alpha = womersley_number(
                network.mean_radius(), omega, conditions.viscosity_pa_s, conditions.density
            )
            factor = impedance_factor(alpha).real
        lost += float(weight[k, 0] * (factor * resistance) @ np.abs(series) ** 2)
    return power, lost


def _nodal(network: VesselNetwork, solution: PulsatileSolution) -> tuple[ComplexArray, FloatArray]:
    """Net flow from each node into vessels, and the sum of sizes, (k, m)."""
    count = len(network.nodes)
    net = np.zeros((len(solution.harmonic), count), dtype=np.complex128)
    through = np.zeros((len(solution.harmonic), count))
    for column, flows, sign in ((0, solution.flow_in, 1.0), (1, solution.flow_out, -1.0)):
        where = network.vessel_nodes[:, column]
        for k, flow in enumerate(flows):
            net[k] += sign * np.bincount(where, weights=flow.real, minlength=count)
            net[k] += 1j * sign * np.bincount(where, weights=flow.imag, minlength=count)
            through[k] += np.bincount(where, weights=np.abs(flow), minlength=count)
    return net, through


def steady_at_probes(
    network: VesselNetwork, solution: FlowSolution, conditions: FlowConditions, probes: Probes
) -> ProbeWaves:
    """Pressure and flow at probes in steady flow, one time.

    Losses count where the flow enters the vessel.

    Along a vessel the pressure falls as the resistance before the probe does, exactly for tapers
    and bends of the polyline. In rigid walls the flow is the same along a vessel at every moment,
    and both are exact for the model: the ideal that 1D and 3D are compared with. With an elastic
    wall the lumped model knows the flow at a vessel's ends only; between, what flows in is stored
    as the compliance lies along the vessel, and the pressure follows the flow amid the vessel, of
    second order in its length as the model is.

    Raises
    ------
    FlowError
        For a probe outside the network.
    """
    probes.check(network)
    flow, first = solution.flow[probes.vessel], network.vessel_nodes[probes.vessel, 0]
    heads = heads_of(network, probes)
    before = drops_of(heads, measure_pipes(heads), conditions.whole_fluid, None).at(flow).resistance
    pressure = solution.pressure[first] - before * flow
    if solution.loss is not None:
        pressure -= np.maximum(solution.loss[probes.vessel], 0.0)
    return ProbeWaves(np.zeros(1), pressure[:, None], flow[:, None])


def pulsatile_at_probes(
    network: VesselNetwork,
    solution: PulsatileSolution,
    conditions: PulsatileConditions,
    probes: Probes,
    count: int = 100,
) -> ProbeWaves:
    """Waves of pressure and flow at probes, at ``count`` times of a cycle.

    Raises
    ------
    FlowError
        For a probe outside the network.
    """
    probes.check(network)
    heads, first = heads_of(network, probes), network.vessel_nodes[probes.vessel]
    stored = _share(conditions.wall.compliance(network), conditions.wall.compliance(heads), probes)
    enters, leaves = solution.flow_in[:, probes.vessel], solution.flow_out[:, probes.vessel]
    begin, end = (solution.pressure[:, nodes] for nodes in first.T)
    flow = enters + stored * (leaves - enters)
    pressure = begin + _impedance_share(network, heads, conditions, solution, probes) * (
        end - begin
    )
    times = solution.times(count)
    return ProbeWaves(times, solution.at(pressure, times).T, solution.at(flow, times).T)


def _impedance_share(
    network: VesselNetwork,
    heads: VesselNetwork,
    conditions: PulsatileConditions,
    solution: PulsatileSolution,
    probes: Probes,
) -> ComplexArray:
    """Part of each vessel's impedance that lies before its probe, (k, p).

    Womersley's is lumped at the mean radius: its part is that of the resistance.
    """
    whole, part = (
        conditions.viscosity_pa_s * 8.0 / np.pi * integrals(each)[POWERS[-4]]
        for each in (network, heads)
    )
    turn = np.zeros((len(solution.harmonic), 1), dtype=np.complex128)
    if conditions.profile == "poiseuille":
        turn += 1j * solution.omega[:, None]
    inert = PARABOLIC * plug_inertance(network, conditions.density)[probes.vessel]
    before = PARABOLIC * plug_inertance(heads, conditions.density)
    return np.asarray((part + turn * before) / (whole[probes.vessel] + turn * inert))


def _share(whole: FloatArray, part: FloatArray, probes: Probes) -> FloatArray:
    each = whole[probes.vessel]
    return np.divide(part, each, out=probes.fraction.copy(), where=each > 0.0)
