"""Summarise a pulsatile 0D solution: totals, extremes, and waves at inlets and outlets."""

from __future__ import annotations

import numpy as np

from design.hemodynamics.vessel_coefficients import (
    impedance_factor,
    vessel_resistance,
    womersley_number,
)
from design.hemodynamics.zero_d.boundary import boundary_nodes
from design.hemodynamics.zero_d.pulsatile.conditions import PulsatileConditions
from design.hemodynamics.zero_d.pulsatile.solution import (
    ComplexArray,
    PulsatileSolution,
    cycle_extremes,
)
from design.hemodynamics.zero_d.pulsatile.table import pulse_numbers, shear_phasors
from design.network import VesselNetwork
from design.units import PA_PER_MMHG, UL_S_PER_ML_MIN
from kernels.arrays import FloatArray, IntArray

_UW_PER_PA_UL_S = 1e-3
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
        "dissipated_uw": lost * _UW_PER_PA_UL_S,
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
