"""Classify each vessel's wall shear as below, inside or above a wanted range."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.hemodynamics.vessel_coefficients import POWERS, integrals
from design.hemodynamics.zero_d.flow import FlowSolution
from design.network import VesselNetwork
from design.units import DYN_CM2_PER_PA

ENOUGH: Final = 0.9
"""Share of the wall's area inside the band for the whole to be called inside."""

PLACES: Final = ("below", "inside", "above")


@dataclass(frozen=True)
class ShearBand:
    """Least and greatest wall shear wanted, Pa; both belong to it."""

    low_pa: float
    high_pa: float

    def __post_init__(self) -> None:
        if not 0.0 <= self.low_pa < self.high_pa < np.inf:
            raise FlowError(
                f"the band of wall shear goes from {self.low_pa:g} to {self.high_pa:g} Pa; give "
                "two rising numbers from 0 on"
            )


def classify_shear(solution: FlowSolution, band: ShearBand) -> NDArray[np.str_]:
    """Where each vessel's wall shear lies, (v,): below, inside or above."""
    shear = np.abs(solution.wall_shear)
    return np.array(PLACES)[(shear >= band.low_pa).astype(int) + (shear > band.high_pa)]


def band_summary(
    network: VesselNetwork, solution: FlowSolution, band: ShearBand
) -> dict[str, float | str]:
    """Shares of vessels, of their length and of their wall's area in, below and above the band.

    ``verdict`` is where `ENOUGH` of the area lies, and ``mixed`` where nowhere does; wall shear is
    that at each vessel's mean radius.
    """
    where, measured = classify_shear(solution, band), integrals(network)
    amounts = {
        "vessels": np.ones(network.vessel_count),
        "length": measured[0],
        "area": measured[POWERS[1]],
    }
    summary: dict[str, float | str] = {
        "low_dyn_cm2": band.low_pa * DYN_CM2_PER_PA,
        "high_dyn_cm2": band.high_pa * DYN_CM2_PER_PA,
    }
    for name, amount in amounts.items():
        for place in PLACES:
            summary[f"{name}_{place}"] = float(amount[where == place].sum() / amount.sum())
    most = [place for place in PLACES if float(summary[f"area_{place}"]) >= ENOUGH]
    return summary | {"verdict": most[0] if most else "mixed"}
