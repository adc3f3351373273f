"""Data class of one periodic cycle of 1D flow, with velocity, wall shear, Reynolds number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.hemodynamics.probes import ProbeWaves
from kernels.arrays import FloatArray


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
