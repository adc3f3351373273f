"""Resistance of each vessel by Poiseuille's law: viscosity times (8/π) ∫ ds/r⁴."""

from __future__ import annotations

import numpy as np

from design.errors import FlowError
from design.hemodynamics.vessel.geometry import POWERS, integrals
from design.network import VesselNetwork
from kernels.arrays import FloatArray


def vessel_resistance(network: VesselNetwork, viscosity_pa_s: float) -> FloatArray:
    """Resistance of each vessel, (v,), Pa·s/µL: viscosity times (8/π) ∫ ds/r⁴.

    Along a piece of length ℓ whose radius goes linearly from a to b the integral is
    ℓ (a² + a b + b²) / (3 a³ b³). Valid for gentle tapers and fully developed laminar flow.

    Raises
    ------
    FlowError
        For a vessel of zero length, or one whose resistance leaves the range of numbers.
    """
    return resistance_of(network, viscosity_pa_s, integrals(network))


def resistance_of(
    network: VesselNetwork, viscosity_pa_s: float, measured: FloatArray
) -> FloatArray:
    """As `vessel_resistance`, of a network whose `integrals` are known."""
    resistance = viscosity_pa_s * (8.0 / np.pi) * measured[POWERS[-4]]
    lengths = measured[0]
    flat = np.flatnonzero(~(lengths > 0.0))
    if len(flat):
        raise FlowError(
            f"vessel {int(flat[0])} has zero length ({len(flat)} such vessels), and so no "
            "resistance; remove it or move its ends apart"
        )
    absurd = np.flatnonzero(~(np.isfinite(resistance) & (resistance > 0.0)))
    if len(absurd):
        vessel = int(absurd[0])
        raise FlowError(
            f"vessel {vessel}: resistance {resistance[vessel]:g} Pa·s/µL from length "
            f"{lengths[vessel]:g} mm and radius {network.mean_radius()[vessel]:g} mm; check the "
            "network's unit"
        )
    return resistance
