"""Outlet models (resistance, Windkessel) as flow-pressure laws for each 3D time step.

A Windkessel's inner pressure obeys C ṗ_c = Q - (p_c - p_d)/R_d, and p = R_p Q + p_c. With second-
order backward differences it is a resistance in each step, p = Z Q + h, which is solved with the
flow at once: stable whatever the step (Esmaily Moghadam, Vignon-Clementel, Figliola & Marsden 2013,
doi 10.1016/j.jcp.2012.07.035).
"""

from __future__ import annotations

import numpy as np

from design.hemodynamics.three_d.port_plan import CoupledPorts, GivenFlow
from design.hemodynamics.zero_d.pulsatile.conditions import ResistanceOutlet, WindkesselOutlet
from kernels.arrays import FloatArray


class OutletLaws:
    """Laws of all coupled groups, Q - D p = s, and what Windkessels hold.

    Attributes
    ----------
    slope : (m,) float64, µL/(Pa·s)
        D, the same at all times.
    """

    def __init__(
        self, coupled: tuple[CoupledPorts, ...], step_s: float, pressure: FloatArray
    ) -> None:
        """Begin in steady flow with these pressures (m,) at the groups."""
        self._laws, self._step_s = [c.law for c in coupled], step_s
        self.slope = np.array([self._slope(law) for law in self._laws]).reshape(-1)
        self._now = np.zeros(len(coupled))
        for k, law in enumerate(self._laws):
            if isinstance(law, WindkesselOutlet):
                share = law.distal / (law.proximal + law.distal)
                self._now[k] = law.distal_pa + share * (pressure[k] - law.distal_pa)
        self._before = self._now

    def given(self, time_s: float) -> FloatArray:
        """S (m,) at the time stepped to, µL/s."""
        sources = np.zeros(len(self._laws))
        for k, law in enumerate(self._laws):
            if isinstance(law, GivenFlow):
                sources[k] = law.factor * float(law.waveform.at(np.array([time_s]))[0])
            elif isinstance(law, ResistanceOutlet):
                sources[k] = -law.distal_pa / law.resistance
            else:
                sources[k] = -self.slope[k] * self._inner(k, law, 0.0)
        return sources

    def keep(self, flow: FloatArray) -> None:
        """Take the step with this flow (m,), µL/s."""
        new = self._now.copy()
        for k, law in enumerate(self._laws):
            if isinstance(law, WindkesselOutlet):
                new[k] = self._inner(k, law, float(flow[k]))
        self._before, self._now = self._now, new

    def start_periodic(self, flow: FloatArray) -> None:
        """Begin with the Windkessels' periodic pressures at these flows of a cycle (m, steps).

        By the same backward differences as the steps', each harmonic for itself.
        """
        steps = flow.shape[1]
        turn = np.exp(-2j * np.pi * np.arange(steps // 2 + 1) / steps)
        rate = (1.5 - 2.0 * turn + 0.5 * turn**2) / self._step_s
        self._now, self._before = self._now.copy(), self._before.copy()
        for k, law in enumerate(self._laws):
            if isinstance(law, WindkesselOutlet):
                above = np.fft.rfft(flow[k]) / (law.compliance * rate + 1.0 / law.distal)
                pressure = law.distal_pa + np.fft.irfft(above, steps)
                self._now[k], self._before[k] = pressure[0], pressure[-1]

    def stored(self) -> FloatArray:
        """Pressure in the Windkessels (m,), Pa; 0 for other laws."""
        return self._now.copy()

    def shift(self, pressure: FloatArray) -> None:
        """Add to the pressure in the Windkessels (m,), Pa."""
        self._now, self._before = self._now + pressure, self._before + pressure

    def _slope(self, law: GivenFlow | ResistanceOutlet | WindkesselOutlet) -> float:
        if isinstance(law, GivenFlow):
            return 0.0
        if isinstance(law, ResistanceOutlet):
            return 1.0 / law.resistance
        return 1.0 / (law.proximal + 1.0 / self._leak(law))

    def _leak(self, law: WindkesselOutlet) -> float:
        return 1.5 * law.compliance / self._step_s + 1.0 / law.distal

    def _inner(self, k: int, law: WindkesselOutlet, flow: float) -> float:
        """Pressure behind the first resistance, Pa."""
        held = law.compliance * (2.0 * self._now[k] - 0.5 * self._before[k]) / self._step_s
        return (flow + law.distal_pa / law.distal + held) / self._leak(law)
