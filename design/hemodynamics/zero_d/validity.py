"""Check each vessel for laminar, developed flow (Poiseuille); refuse absurd pressure drops."""

from __future__ import annotations

from typing import Final

import numpy as np

from design.errors import FlowError
from design.hemodynamics.zero_d.flow import FlowSolution
from design.network import VesselNetwork
from design.units import PA_PER_MMHG, WATER_DENSITY
from kernels.arrays import FloatArray

LAMINAR_REYNOLDS: Final = 2000.0
"""Below it pipe flow stays laminar."""

ENTRANCE_SHARE: Final = 0.1
"""Share of a vessel that the flow may take to develop, for Poiseuille's law to be called right."""

QUESTIONED_MMHG: Final = 100_000.0
"""Pressure drops above it, 13 MPa, come from a wrong unit and not from a perfusion."""


def question_pressure(drop_pa: float) -> None:
    """Refuse a pressure that nobody perfuses with.

    Raises
    ------
    FlowError
        When it is above `QUESTIONED_MMHG`.
    """
    drop = abs(drop_pa) / PA_PER_MMHG
    if not drop <= QUESTIONED_MMHG:
        raise FlowError(
            f"the flow would take {drop:.3g} mmHg, above {QUESTIONED_MMHG:g}: is the network in "
            "another unit, the flow in µL/min, or the viscosity in Pa·s?"
        )


def reynolds(
    network: VesselNetwork, solution: FlowSolution, density: float = WATER_DENSITY
) -> FloatArray:
    """Reynolds number 8 ϱ v²/|τ_w| at the mean radius, (v,); ``density`` in Pa·s²/mm².

    For a Newtonian fluid it is ϱ |v| d/μ; for others that of Metzner & Reed 1955 (doi
    10.1002/aic.690010409), at which pipe flow has the friction of a Newtonian one's.
    """
    shear = np.abs(solution.wall_shear)
    moves = shear > 0.0
    number = np.zeros(network.vessel_count)
    number[moves] = 8.0 * density * solution.velocity[moves] ** 2 / shear[moves]
    return number


def entrance_share(network: VesselNetwork, reynolds_number: FloatArray) -> FloatArray:
    """Length in which a flat profile becomes parabolic over the vessel's length, (v,).

    L/d = (0.619^1.6 + (0.0567 Re)^1.6)^(1/1.6), laminar pipe flow, Durst et al. 2005,
    doi 10.1115/1.2063088. It is an upper bound where the flow comes developed from a vessel
    before.
    """
    diameters = (0.619**1.6 + (0.0567 * reynolds_number) ** 1.6) ** (1.0 / 1.6)
    return diameters * 2.0 * network.mean_radius() / network.lengths()


def poiseuille_holds(network: VesselNetwork, reynolds_number: FloatArray) -> np.ndarray:
    """Whether flow is laminar, and developed but for a tenth of the vessel, (v,) bool."""
    short = entrance_share(network, reynolds_number) <= ENTRANCE_SHARE
    return short & (reynolds_number < LAMINAR_REYNOLDS)
