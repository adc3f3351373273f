"""Data class of one periodic cycle of 1D flow, with velocity, wall shear, Reynolds number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics.conditions import PulsatileConditions
from design.hemodynamics.probes import ProbeWaves
from design.hemodynamics.vessel_coefficients import plug_inertance, wave_speed, womersley_number
from design.hemodynamics.zero_d.boundary import boundary_nodes
from design.hemodynamics.zero_d.report import vessel_columns
from design.network import VesselNetwork
from design.units import PA_PER_MMHG, UL_S_PER_ML_MIN
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class OneDSolution:
    """A cycle of flow as it repeats, sampled evenly, its end left out.

    Attributes
    ----------
    period_s : float, s
    time_s : (t,) float64, s
    pressure_in, pressure_out : (v, t) float64, Pa
        At each vessel's first and last node.
    flow_in, flow_out : (v, t) float64, µL/s
        Into each vessel at its first node, and out of it at its last.
    pressure, flow, area : (v, t) float64, Pa, µL/s, mm²
        Amid each vessel.
    pressure_low, pressure_high : (v,) float64, Pa
        Extremes anywhere in a vessel.
    rest_area : (v,) float64, mm²
        Amid each vessel, at no pressure.
    probes : ProbeWaves or None
        At the probes asked for.
    change : (c,) float64
        From each cycle's begin to its end, over the swing.
    mass_imbalance : float
        What went in over the last cycle less what came out and what stayed, over the greatest
        flow times the period.
    steps, cells : int
        Of the last cycle; of the network.
    friction_exponent : (v,) float64
        ζ of the velocity profile.
    probe_area : (p, t) float64, mm², or None
        At the probes asked for.
    """

    period_s: float
    time_s: FloatArray
    pressure_in: FloatArray
    pressure_out: FloatArray
    flow_in: FloatArray
    flow_out: FloatArray
    pressure: FloatArray
    flow: FloatArray
    area: FloatArray
    pressure_low: FloatArray
    pressure_high: FloatArray
    rest_area: FloatArray
    probes: ProbeWaves | None
    change: FloatArray
    mass_imbalance: float
    steps: int
    cells: int
    friction_exponent: FloatArray
    probe_area: FloatArray | None

    def velocity(self) -> FloatArray:
        """Mean over the cross-section amid each vessel, (v, t), mm/s."""
        return self.flow / self.area

    def wall_shear(self, viscosity_pa_s: float) -> FloatArray:
        """(ζ + 2) μ U/R amid each vessel, (v, t), Pa: the profile's, in step with the flow."""
        radius = np.sqrt(self.area / np.pi)
        steep = self.friction_exponent[:, None] + 2.0
        return np.asarray(steep * viscosity_pa_s * self.velocity() / radius)

    def reynolds(self, viscosity_pa_s: float, density: float) -> FloatArray:
        """ϱ |U| d/μ at its greatest, (v,)."""
        across = 2.0 * np.sqrt(self.area / np.pi)
        number = density * np.abs(self.velocity()) * across / viscosity_pa_s
        return np.asarray(number.max(axis=1))


# Summarise a 1D flow solution: means, extremes, inlet and outlet waveforms over a cycle.


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


# Make a table of each vessel's pressures, flows and wall shear from a 1D flow solution.

Table = dict[str, NDArray[np.generic]]


def one_d_table(
    network: VesselNetwork, solution: OneDSolution, conditions: PulsatileConditions
) -> Table:
    """Columns of a per-vessel table, each (v,).

    Flow, shear and numbers are those amid a vessel, pressures at its ends, and
    ``pressure_…_anywhere`` along all of it. An amplitude is half of what lies between least and
    greatest. ``wave_share`` is the length over the wavelength of the cycle, ``widest`` and
    ``narrowest`` diameters over the rest's.
    """
    table = vessel_columns(network)
    for name, waves in (("in", solution.pressure_in), ("out", solution.pressure_out)):
        table |= _wave(f"pressure_{name}", waves, "pa")
        table |= {
            f"pressure_{name}_{what}_mmhg": values / PA_PER_MMHG
            for what, values in (
                ("min", waves.min(axis=1)),
                ("mean", waves.mean(axis=1)),
                ("max", waves.max(axis=1)),
            )
        }
    table |= {
        "pressure_min_anywhere_pa": solution.pressure_low,
        "pressure_max_anywhere_pa": solution.pressure_high,
    }
    table |= _wave("flow", solution.flow, "ul_s")
    table |= {
        "flow_min_ul_s": solution.flow.min(axis=1),
        "flow_max_ul_s": solution.flow.max(axis=1),
        "flow_mean_ml_min": solution.flow.mean(axis=1) / UL_S_PER_ML_MIN,
        "flow_amplitude_ml_min": np.ptp(solution.flow, axis=1) / 2.0 / UL_S_PER_ML_MIN,
    }
    return table | _shear(solution, conditions) | _numbers(network, solution, conditions)


def _wave(name: str, values: FloatArray, unit: str) -> Table:
    return {
        f"{name}_mean_{unit}": values.mean(axis=1),
        f"{name}_amplitude_{unit}": np.ptp(values, axis=1) / 2.0,
    }


def _shear(solution: OneDSolution, conditions: PulsatileConditions) -> Table:
    shear = solution.wall_shear(conditions.viscosity_pa_s)
    size = np.abs(shear).mean(axis=1)
    mean = shear.mean(axis=1)
    share = np.divide(np.abs(mean), size, out=np.ones_like(size), where=size > 0.0)
    return _wave("wall_shear", shear, "pa") | {
        "wall_shear_min_pa": shear.min(axis=1),
        "wall_shear_max_pa": shear.max(axis=1),
        "oscillating_shear": np.maximum(0.0, (1.0 - share) / 2.0),
    }


def _numbers(
    network: VesselNetwork, solution: OneDSolution, conditions: PulsatileConditions
) -> Table:
    viscosity, density = conditions.viscosity_pa_s, conditions.density
    omega = 2.0 * np.pi / solution.period_s
    speed = wave_speed(
        plug_inertance(network, density), conditions.wall.compliance(network), network.lengths()
    )
    rest = solution.rest_area
    return {
        "reynolds_max": solution.reynolds(viscosity, density),
        "womersley": womersley_number(network.mean_radius(), omega, viscosity, density),
        "wave_speed_mm_s": speed,
        "wave_share": network.lengths() / (speed * solution.period_s),
        "speed_over_wave_speed": np.abs(solution.velocity()).max(axis=1) / speed,
        "widest": np.sqrt(solution.area.max(axis=1) / rest),
        "narrowest": np.sqrt(solution.area.min(axis=1) / rest),
    }
