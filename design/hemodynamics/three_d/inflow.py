"""Make inlet velocity profiles over one cycle (Womersley or Poiseuille) for 3D flow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics.three_d.lumen_mesh import LumenMesh
from design.hemodynamics.three_d.port_plan import PortPlan
from design.hemodynamics.three_d.port_profile import unit_profile
from design.hemodynamics.three_d.stokes import Spaces
from design.hemodynamics.waveforms.waveform import harmonics_of
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class Inflow:
    """Profiles and the harmonics that drive them: u(t) = Re Σ profile_k exp(i ω_k t).

    Attributes
    ----------
    omega : (k,) float64, rad/s
    profile : (k, n) complex128
        With its harmonic's flow.
    """

    omega: FloatArray
    profile: NDArray[np.complex128]

    def at(self, time_s: float) -> FloatArray:
        """Given unknowns, (n,)."""
        return np.asarray((np.exp(1j * self.omega * time_s) @ self.profile).real)


def inflow_of(room: Spaces, mesh: LumenMesh, plan: PortPlan, period_s: float, steps: int) -> Inflow:
    """Womersley's profile for each harmonic of the inlet's flow, or Poiseuille's for all."""
    if plan.inflow is None:
        return Inflow(np.zeros(1), np.zeros((1, room.count), dtype=np.complex128))
    number, (phasor,) = harmonics_of([plan.flow], period_s, steps)
    omega: FloatArray = 2.0 * np.pi * number.astype(np.float64) / period_s
    steady = unit_profile(room, mesh, plan.inflow)
    per_omega = plan.density / plan.viscosity_pa_s if plan.womersley else 0.0
    shapes = [
        unit_profile(room, mesh, plan.inflow, 1j * w * per_omega) if w * per_omega else steady
        for w in omega
    ]
    return Inflow(omega, phasor[:, None] * np.array(shapes))
