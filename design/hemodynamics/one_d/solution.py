"""One periodic cycle of 1D flow: waves, summary and table of vessels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.hemodynamics.conditions import PulsatileConditions
from design.hemodynamics.probes import ProbeWaves
from design.hemodynamics.vessel_coefficients import plug_inertance, wave_speed, womersley_number
from design.hemodynamics.zero_d.boundary import boundary_nodes
from design.hemodynamics.zero_d.pulsatile_report import (
    Swing,
    Table,
    end_columns,
    flow_columns,
    inlet_summary,
    pressure_columns,
    shear_columns,
)
from design.hemodynamics.zero_d.report import vessel_columns
from design.network import VesselNetwork
from design.units import PA_PER_MMHG
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
        At the options' probes.
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
        At the options' probes.
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


def one_d_waves(
    network: VesselNetwork, solution: OneDSolution, conditions: PulsatileConditions
) -> dict[str, FloatArray]:
    """Flow through inlets and outlets and their mean pressures, over one cycle, (t,)."""

    def through(nodes: IntArray, sign: float) -> tuple[FloatArray, FloatArray]:
        first, last = (np.isin(end, nodes) for end in network.vessel_nodes.T)
        flow = solution.flow_in[first].sum(axis=0) - solution.flow_out[last].sum(axis=0)
        ends = np.concatenate([solution.pressure_in[first], solution.pressure_out[last]])
        return np.asarray(sign * flow), np.asarray(ends.mean(axis=0))

    inlets, outlets = boundary_nodes(network, conditions)
    return end_columns(solution.time_s, through(inlets, 1.0), through(outlets, -1.0))


def one_d_summary(
    network: VesselNetwork, solution: OneDSolution, conditions: PulsatileConditions
) -> dict[str, float]:
    """Totals and extremes for a report; keys name their units."""
    numbers = _numbers(network, solution, conditions)
    waves = one_d_waves(network, solution, conditions)
    shear = solution.wall_shear(conditions.viscosity_pa_s)
    summary = {
        "period_s": solution.period_s,
        "cells": float(solution.cells),
        "steps": float(solution.steps),
        "cycles": float(len(solution.change)),
        "last_change": float(solution.change[-1]),
        "mass_imbalance": solution.mass_imbalance,
        **inlet_summary(waves),
        "inlet_pulse_mmhg": float(np.ptp(waves["inlet_pressure_mmhg"])),
        "outlet_pulse_mmhg": float(np.ptp(waves["outlet_pressure_mmhg"])),
        "pressure_max_mmhg": float(solution.pressure_high.max()) / PA_PER_MMHG,
        "wall_shear_peak_pa": float(np.abs(shear).max()),
    }
    for name in ("reynolds_max", "womersley", "wave_share", "widest"):
        summary[f"{name.removesuffix('_max')}_max"] = float(numbers[name].max())
    return summary | {"wave_speed_min_mm_s": float(numbers["wave_speed_mm_s"].min())}


def one_d_table(
    network: VesselNetwork, solution: OneDSolution, conditions: PulsatileConditions
) -> Table:
    """Columns of a per-vessel table, each (v,).

    Flow, shear and numbers are those amid a vessel, pressures at its ends, and
    ``pressure_…_anywhere`` along all of it. An amplitude is half of what lies between least and
    greatest. ``wave_share`` is the length over the wavelength of the cycle, ``widest`` and
    ``narrowest`` diameters over the rest's.
    """
    shear = solution.wall_shear(conditions.viscosity_pa_s)
    return (
        vessel_columns(network)
        | pressure_columns("in", _swing(solution.pressure_in))
        | pressure_columns("out", _swing(solution.pressure_out))
        | {
            "pressure_min_anywhere_pa": solution.pressure_low,
            "pressure_max_anywhere_pa": solution.pressure_high,
        }
        | flow_columns(_swing(solution.flow))
        | shear_columns(_swing(shear), np.abs(shear).mean(axis=1))
        | _numbers(network, solution, conditions)
    )


def _swing(waves: FloatArray) -> Swing:
    return Swing(waves.mean(axis=1), waves.min(axis=1), waves.max(axis=1))


def _numbers(
    network: VesselNetwork, solution: OneDSolution, conditions: PulsatileConditions
) -> dict[str, FloatArray]:
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
