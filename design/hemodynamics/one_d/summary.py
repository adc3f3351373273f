"""Summarise a 1D flow solution: means, extremes, inlet and outlet waveforms over a cycle."""

from __future__ import annotations

import numpy as np

from design.hemodynamics.one_d.solution import OneDSolution
from design.hemodynamics.one_d.table import one_d_table
from design.hemodynamics.zero_d.boundary import boundary_nodes
from design.hemodynamics.zero_d.pulsatile.conditions import PulsatileConditions
from design.network import VesselNetwork
from design.units import PA_PER_MMHG, UL_S_PER_ML_MIN
from kernels.arrays import FloatArray, IntArray


def one_d_waves(
    network: VesselNetwork, solution: OneDSolution, conditions: PulsatileConditions
) -> dict[str, FloatArray]:
    """Flow through inlets and outlets and their mean pressures, over one cycle, (t,)."""
    inlets, outlets = boundary_nodes(network, conditions)
    waves: dict[str, FloatArray] = {"time_s": solution.time_s}
    for name, nodes, sign in (("inlet", inlets, 1.0), ("outlet", outlets, -1.0)):
        flow, pressure = _through(network, solution, nodes)
        waves[f"{name}_flow_ml_min"] = sign * flow / UL_S_PER_ML_MIN
        waves[f"{name}_pressure_mmhg"] = pressure / PA_PER_MMHG
    return waves


def _through(
    network: VesselNetwork, solution: OneDSolution, nodes: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Flow into the network at nodes, and their vessel ends' mean pressure, (t,)."""
    first, last = (np.isin(end, nodes) for end in network.vessel_nodes.T)
    flow = solution.flow_in[first].sum(axis=0) - solution.flow_out[last].sum(axis=0)
    ends = np.concatenate([solution.pressure_in[first], solution.pressure_out[last]])
    return np.asarray(flow), np.asarray(ends.mean(axis=0))


def one_d_summary(
    network: VesselNetwork, solution: OneDSolution, conditions: PulsatileConditions
) -> dict[str, float]:
    """Totals and extremes for a report; keys name their units."""
    table = {
        name: np.asarray(column, dtype=np.float64)
        for name, column in one_d_table(network, solution, conditions).items()
        if name != "kind"
    }
    waves = one_d_waves(network, solution, conditions)
    summary = {
        "period_s": solution.period_s,
        "cells": float(solution.cells),
        "steps": float(solution.steps),
        "cycles": float(len(solution.change)),
        "last_change": float(solution.change[-1]),
        "mass_imbalance": solution.mass_imbalance,
        "inlet_flow_mean_ml_min": float(waves["inlet_flow_ml_min"].mean()),
        "inlet_flow_amplitude_ml_min": float(np.ptp(waves["inlet_flow_ml_min"]) / 2.0),
        "inlet_pressure_mean_mmhg": float(waves["inlet_pressure_mmhg"].mean()),
        "inlet_pulse_mmhg": float(np.ptp(waves["inlet_pressure_mmhg"])),
        "outlet_pulse_mmhg": float(np.ptp(waves["outlet_pressure_mmhg"])),
        "pressure_max_mmhg": float(solution.pressure_high.max()) / PA_PER_MMHG,
        "wall_shear_peak_pa": float(
            np.maximum(np.abs(table["wall_shear_min_pa"]), table["wall_shear_max_pa"]).max()
        ),
    }
    for name in ("reynolds_max", "womersley", "wave_share", "widest"):
        key = f"{name.removesuffix('_max')}_max"
        summary[key] = float(table[name].max())
    return summary | {"wave_speed_min_mm_s": float(table["wave_speed_mm_s"].min())}
