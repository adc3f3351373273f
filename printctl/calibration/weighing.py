"""Volume per plunger travel, by weight."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Printer, Syringe
from printctl.calibration.estimate import Estimate, fit_line
from printctl.errors import UsageError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Weighing:
    """What doses of known travel weigh.

    Attributes
    ----------
    ul_per_mm : Estimate
        Volume per plunger travel.
    lost_ul : Estimate or None
        Volume missing from every dose (evaporation, a drop that stays), where doses differ.
    scatter_ul : float
        Standard deviation of one dose.
    """

    ul_per_mm: Estimate
    lost_ul: Estimate | None
    scatter_ul: float

    def bore_mm(self) -> Estimate:
        """Bore that would give this volume, where the steps are right: √(4k/π)."""
        k = self.ul_per_mm
        value, low, high = (math.sqrt(max(0.0, 4 * x / math.pi)) for x in (k.value, k.low, k.high))
        return Estimate(value, low, high, "mm")

    def steps_per_mm(self, printer: Printer, syringe: Syringe) -> Estimate:
        """Steps/mm that make travel true, where the bore is right: steps × (πD²/4)/k."""
        area = math.pi / 4 * syringe.inner_mm**2
        k = self.ul_per_mm
        value, high, low = (printer.steps_per_mm.e * area / x for x in (k.value, k.low, k.high))
        return Estimate(value, low, high, "steps/mm")

    def steps_per_ul(self, printer: Printer) -> Estimate:
        """Motor steps per volume, whichever of the two is wrong."""
        k = self.ul_per_mm
        value, high, low = (printer.steps_per_mm.e / x for x in (k.value, k.low, k.high))
        return Estimate(value, low, high, "steps/µL")


def fit_weighing(
    travel_mm: FloatArray,
    mass_mg: FloatArray,
    density_g_cm3: float,
    density_error: float = 0.0,
) -> Weighing:
    """Fit volume = k · travel − lost; without a loss where all doses are alike.

    Parameters
    ----------
    travel_mm, mass_mg : (n,) float64
        Commanded travel and weight of each dose.
    density_g_cm3 : float
        Of what was weighed, at its temperature.
    density_error : float, g/cm³
        Half of its own 95 % interval; added in quadrature.

    Raises
    ------
    UsageError
        With too few doses, or doses that weigh nothing.
    """
    if not np.all(travel_mm > 0) or not np.all(mass_mg > 0):
        raise UsageError(
            "travel_mm and mass_mg must be above 0 in every row; leave out a dose that failed"
        )
    volume = mass_mg / density_g_cm3  # 1 mg / (g/cm³) = 1 µL
    alike = float(np.ptp(travel_mm)) < 0.05 * float(travel_mm.mean())
    columns = travel_mm[:, None]
    if not alike:
        columns = np.column_stack([travel_mm, -np.ones(len(travel_mm))])
    fit = fit_line(columns, volume, "weighing")
    k = fit.estimate(0, "µL/mm")
    if k.low <= 0:
        raise UsageError(
            f"volume per travel is {k.text()}: the doses scatter too much; weigh larger ones"
        )
    half = math.hypot((k.high - k.low) / 2, k.value * density_error / density_g_cm3)
    lost = None if alike else fit.estimate(1, "µL")
    return Weighing(Estimate(k.value, k.value - half, k.value + half, k.unit), lost, fit.residual)
