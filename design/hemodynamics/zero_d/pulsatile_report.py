"""Report pulsatile 0D flow: table of vessels, summary, waves at ends and at probes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics.conditions import FlowConditions, PulsatileConditions
from design.hemodynamics.pressure_drops import drops_of, heads_of, measure_pipes
from design.hemodynamics.probes import Probes, ProbeWaves
from design.hemodynamics.vessel_coefficients import (
    PARABOLIC,
    POWERS,
    QUASI_STEADY,
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
    SAMPLES,
    ComplexArray,
    PulsatileSolution,
    cycle_extremes,
)
from design.hemodynamics.zero_d.report import (
    ENTRANCE_SHARE,
    LAMINAR_REYNOLDS,
    UW_PER_PA_UL_S,
    entrance_share,
    vessel_columns,
)
from design.hemodynamics.zero_d.steady import FlowSolution
from design.network import VesselNetwork
from design.units import PA_PER_MMHG, UL_S_PER_ML_MIN
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class PulseNumbers:
    """Numbers that say how a pulse goes through each vessel, all (v,).

    Attributes
    ----------
    womersley : float64
        At the fundamental frequency; 0 where nothing changes.
    reynolds : float64
        At the greatest flow.
    wave_speed : float64, mm/s
        Pulse wave velocity; infinite in a rigid vessel.
    wave_share : float64
        Length over the wavelength of the fundamental; a lumped vessel needs it well below 1.
    quasi_steady : bool
        Womersley number below 1: the profile stays a parabola in step with the pressure.
    poiseuille : bool
        Quasi-steady, laminar, and developed but for a tenth of the length.
    """

    womersley: FloatArray
    reynolds: FloatArray
    wave_speed: FloatArray
    wave_share: FloatArray
    quasi_steady: NDArray[np.bool_]
    poiseuille: NDArray[np.bool_]


def pulse_numbers(
    network: VesselNetwork, solution: PulsatileSolution, conditions: PulsatileConditions
) -> PulseNumbers:
    """Womersley and Reynolds numbers, pulse wave velocity, and what holds in each vessel."""
    radius, length = network.mean_radius(), network.lengths()
    omega = float(solution.omega[1:].min(initial=np.inf))
    omega = omega if np.isfinite(omega) else 0.0
    alpha = womersley_number(radius, omega, conditions.viscosity_pa_s, conditions.density)
    low, high = cycle_extremes(solution, middle_flow(solution))
    peak = np.maximum(np.abs(low), np.abs(high))
    number = 2.0 * conditions.density * peak / (np.pi * radius * conditions.viscosity_pa_s)
    inertance = plug_inertance(network, conditions.density)
    speed = wave_speed(inertance, conditions.wall.compliance(network), length)
    steady = alpha < QUASI_STEADY
    developed = entrance_share(network, number) <= ENTRANCE_SHARE
    return PulseNumbers(
        alpha,
        number,
        speed,
        length * omega / (2.0 * np.pi * speed),
        steady,
        steady & developed & (number < LAMINAR_REYNOLDS),
    )


def middle_flow(solution: PulsatileSolution) -> ComplexArray:
    """Phasors of the flow amid each vessel, (k, v), µL/s."""
    return (solution.flow_in + solution.flow_out) / 2.0


def shear_phasors(
    network: VesselNetwork, solution: PulsatileSolution, conditions: PulsatileConditions
) -> ComplexArray:
    """Phasors of the wall shear at the mean radius, (k, v), Pa, with Womersley's correction."""
    radius = network.mean_radius()
    shear = middle_flow(solution) * (4.0 * conditions.viscosity_pa_s / (np.pi * radius**3))
    for k, omega in enumerate(solution.omega):
        alpha = womersley_number(radius, omega, conditions.viscosity_pa_s, conditions.density)
        shear[k] *= shear_factor(alpha)
    return shear


def pulsatile_table(
    network: VesselNetwork, solution: PulsatileSolution, conditions: PulsatileConditions
) -> dict[str, NDArray[np.generic]]:
    """Columns of a per-vessel table, each (v,).

    An amplitude is half of what lies between least and greatest. ``pressure_damping`` and
    ``flow_damping`` are amplitudes at the vessel's end over those at its begin (1 where nothing
    changes), ``oscillating_shear`` is ½ (1 - |mean τ|/mean |τ|), 0 where the shear keeps its
    direction and ½ where it has none.
    """
    numbers = pulse_numbers(network, solution, conditions)
    table = vessel_columns(network)
    swings = cycle_extremes(solution, solution.pressure)
    for name, nodes in (("in", network.vessel_nodes[:, 0]), ("out", network.vessel_nodes[:, 1])):
        table |= _pressures(
            name, solution.pressure[0].real[nodes], swings[0][nodes], swings[1][nodes]
        )
    table |= _flows(solution)
    table["pressure_damping"] = _ratio(
        table["pressure_out_amplitude_pa"], table["pressure_in_amplitude_pa"]
    )
    table["flow_damping"] = _ratio(
        _amplitude(solution, solution.flow_out), _amplitude(solution, solution.flow_in)
    )
    table |= _shears(solution, shear_phasors(network, solution, conditions))
    return table | {
        "reynolds_max": numbers.reynolds,
        "womersley": numbers.womersley,
        "wave_speed_mm_s": numbers.wave_speed,
        "wave_share": numbers.wave_share,
        "quasi_steady": numbers.quasi_steady.astype(np.int64),
        "poiseuille_holds": numbers.poiseuille.astype(np.int64),
    }


def _pressures(
    name: str, mean: FloatArray, low: FloatArray, high: FloatArray
) -> dict[str, NDArray[np.generic]]:
    return {
        f"pressure_{name}_mean_pa": mean,
        f"pressure_{name}_amplitude_pa": (high - low) / 2.0,
        f"pressure_{name}_min_mmhg": low / PA_PER_MMHG,
        f"pressure_{name}_mean_mmhg": mean / PA_PER_MMHG,
        f"pressure_{name}_max_mmhg": high / PA_PER_MMHG,
    }


def _flows(solution: PulsatileSolution) -> dict[str, NDArray[np.generic]]:
    flow = middle_flow(solution)
    low, high = cycle_extremes(solution, flow)
    mean = flow[0].real
    return {
        "flow_mean_ul_s": mean,
        "flow_amplitude_ul_s": (high - low) / 2.0,
        "flow_min_ul_s": low,
        "flow_max_ul_s": high,
        "flow_mean_ml_min": mean / UL_S_PER_ML_MIN,
        "flow_amplitude_ml_min": (high - low) / 2.0 / UL_S_PER_ML_MIN,
    }


def _shears(solution: PulsatileSolution, shear: ComplexArray) -> dict[str, NDArray[np.generic]]:
    low, high = cycle_extremes(solution, shear)
    mean = shear[0].real
    return {
        "wall_shear_mean_pa": mean,
        "wall_shear_amplitude_pa": (high - low) / 2.0,
        "wall_shear_min_pa": low,
        "wall_shear_max_pa": high,
        "oscillating_shear": _oscillating(solution, shear, mean),
    }


def _oscillating(
    solution: PulsatileSolution, shear: ComplexArray, mean: FloatArray, chunk: int = 20_000
) -> FloatArray:
    size = np.empty(len(mean))
    times = solution.times(SAMPLES)
    for start in range(0, len(mean), chunk):
        part = slice(start, start + chunk)
        size[part] = np.abs(solution.at(shear[:, part], times)).mean(axis=0)
    share = np.divide(np.abs(mean), size, out=np.ones_like(size), where=size > 0.0)
    return np.maximum(0.0, (1.0 - share) / 2.0)


def _amplitude(solution: PulsatileSolution, phasors: ComplexArray) -> FloatArray:
    low, high = cycle_extremes(solution, phasors)
    return (high - low) / 2.0


def _ratio(over: NDArray[np.generic], under: NDArray[np.generic]) -> FloatArray:
    top, bottom = (np.asarray(x, dtype=np.float64) for x in (over, under))
    still = 1e-12 * float(bottom.max(initial=0.0))
    return np.divide(top, bottom, out=np.ones_like(top), where=bottom > still)


# Summarise a pulsatile 0D solution: totals, extremes, and waves at inlets and outlets.

WAVES = 100
"""Times in a cycle of the waves written out."""


def node_phasors(
    network: VesselNetwork, solution: PulsatileSolution, nodes: IntArray
) -> ComplexArray:
    """Flow into the network at some nodes, (k, len(nodes)), µL/s."""
    net, _ = _nodal(network, solution)
    return net[:, nodes]


def end_waves(
    network: VesselNetwork,
    solution: PulsatileSolution,
    conditions: PulsatileConditions,
    count: int = WAVES,
) -> dict[str, FloatArray]:
    """Flow through inlets and outlets and their mean pressures, over one cycle, (count,)."""
    inlets, outlets = boundary_nodes(network, conditions)
    times = solution.times(count)
    waves: dict[str, FloatArray] = {"time_s": times}
    for name, nodes, sign in (("inlet", inlets, 1.0), ("outlet", outlets, -1.0)):
        flow = sign * node_phasors(network, solution, nodes).sum(axis=1)
        pressure = solution.pressure[:, nodes].mean(axis=1)
        waves[f"{name}_flow_ml_min"] = solution.at(flow, times) / UL_S_PER_ML_MIN
        waves[f"{name}_pressure_mmhg"] = solution.at(pressure, times) / PA_PER_MMHG
    return waves


def pulsatile_summary(
    network: VesselNetwork, solution: PulsatileSolution, conditions: PulsatileConditions
) -> dict[str, float]:
    """Totals, extremes and balances for `report.json`; keys name their units.

    ``mass_imbalance`` is the greatest net flow at an inner node over the flow through it, summed
    over harmonics. ``energy_imbalance`` holds the mean power that enters and leaves,
    Σ ½ Re p_k Q_k* over inlets and outlets, against what viscosity takes, Σ ½ Re Z_k |Q_k|²,
    relative to the latter.
    """
    numbers = pulse_numbers(network, solution, conditions)
    low, high = cycle_extremes(solution, solution.pressure)
    inlets, outlets = boundary_nodes(network, conditions)
    waves = end_waves(network, solution, conditions)
    shear_low, shear_high = cycle_extremes(solution, shear_phasors(network, solution, conditions))
    power, lost = mean_powers(network, solution, conditions)
    finite = numbers.wave_speed[np.isfinite(numbers.wave_speed)]
    pulse_in, pulse_out = ((high - low)[nodes].max() for nodes in (inlets, outlets))
    summary = {
        "period_s": solution.period_s,
        "harmonics": float(len(solution.harmonic) - 1),
        "inlet_flow_mean_ml_min": float(waves["inlet_flow_ml_min"].mean()),
        "inlet_flow_amplitude_ml_min": float(np.ptp(waves["inlet_flow_ml_min"]) / 2.0),
        "inlet_pressure_mean_mmhg": float(waves["inlet_pressure_mmhg"].mean()),
        "inlet_pulse_mmhg": float(pulse_in) / PA_PER_MMHG,
        "outlet_pulse_mmhg": float(pulse_out) / PA_PER_MMHG,
        "pressure_max_mmhg": float(high.max()) / PA_PER_MMHG,
        "wall_shear_peak_pa": float(np.maximum(np.abs(shear_low), np.abs(shear_high)).max()),
        "reynolds_max": float(numbers.reynolds.max()),
        "womersley_max": float(numbers.womersley.max()),
        "wave_share_max": float(numbers.wave_share.max()),
        "quasi_steady_share": float(numbers.quasi_steady.mean()),
        "poiseuille_holds_share": float(numbers.poiseuille.mean()),
        "dissipated_uw": lost * UW_PER_PA_UL_S,
        "mass_imbalance": mass_imbalance(network, solution, np.concatenate([inlets, outlets])),
        "energy_imbalance": abs(power - lost) / lost if lost > 0.0 else 0.0,
    }
    if len(finite):
        summary["wave_speed_min_mm_s"] = float(finite.min())
    return summary


def mean_powers(
    network: VesselNetwork, solution: PulsatileSolution, conditions: PulsatileConditions
) -> tuple[float, float]:
    """Mean power into the network at its ends, and what viscosity takes, Pa·µL/s."""
    ends = np.concatenate(boundary_nodes(network, conditions))
    into = node_phasors(network, solution, ends)
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


def mass_imbalance(network: VesselNetwork, solution: PulsatileSolution, ends: IntArray) -> float:
    """Greatest net flow at an inner node over the flow through it."""
    net, through = _nodal(network, solution)
    left, size = np.abs(net).sum(axis=0), through.sum(axis=0)
    inner = size > 0.0
    inner[ends] = False
    return float(np.max(left[inner] / size[inner], initial=0.0))


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


# Evaluate 0D solutions at probes along vessels: pressure and flow, to compare with 1D, 3D.
#
# Along a vessel the pressure falls as the resistance before the probe does, exactly for tapers and
# bends of the polyline. In rigid walls the flow is the same along a vessel at every moment, and
# both are exact for the model: the ideal that 1D and 3D are held against. With an elastic wall the
# lumped model knows the flow at a vessel's ends only; between, what flows in is stored as the
# compliance lies along the vessel, and the pressure follows the flow amid the vessel, of second
# order in its length as the model is.


def steady_at_probes(
    network: VesselNetwork, solution: FlowSolution, conditions: FlowConditions, probes: Probes
) -> ProbeWaves:
    """Pressure and flow at probes in steady flow, one time.

    Losses count where the flow enters the vessel.

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
