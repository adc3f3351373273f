"""Fit volume per plunger travel, or flow through an open valve, from weighed doses of ink."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from firmware_profiles import Printer, Syringe
from kernels.arrays import FloatArray
from printctl.calibration.estimate import Estimate, LineFit, fit_line
from printctl.errors import UsageError

_ALIKE: Final = 0.05
_MAX_SCATTER: Final = 0.1
"""Half of the 95 % interval over the value: a balance and six doses give 0.01, a wrong row more."""


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
        area = syringe.area_mm2
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
    last_digit_mg: float = 0.0,
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
    last_digit_mg : float, mg
        Of the balance.

    Raises
    ------
    UsageError
        With too few doses, or doses that weigh nothing.
    """
    columns = _checked(travel_mm, mass_mg, "travel_mm")
    fit = fit_line(columns, mass_mg / density_g_cm3, "weighing", last_digit_mg / density_g_cm3)
    k = _with_density(fit, density_error / density_g_cm3, "µL/mm", "volume per travel")
    lost = fit.estimate(1, "µL") if columns.shape[1] > 1 else None
    return Weighing(k, lost, fit.residual)


@dataclass(frozen=True)
class FlowWeighing:
    """What doses of known opening times weigh.

    Attributes
    ----------
    flow_ul_s : Estimate
        While the valve is open.
    lost_s : Estimate or None
        Time by which each opening is shorter than commanded (opening less closing delay, and what
        is lost of each dose), where doses differ.
    scatter_ul : float
        Standard deviation of one dose.
    """

    flow_ul_s: Estimate
    lost_s: Estimate | None
    scatter_ul: float


def fit_flow(
    open_s: FloatArray,
    mass_mg: FloatArray,
    density_g_cm3: float,
    density_error: float = 0.0,
    last_digit_mg: float = 0.0,
) -> FlowWeighing:
    """Fit volume = Q · (time − lost); without a loss where all doses are alike.

    Parameters are `fit_weighing`'s, with the seconds for which the valve was commanded open. The
    interval of the lost time takes Q as known: its own scatter is smaller by far.

    Raises
    ------
    UsageError
        With too few doses, or doses that weigh nothing.
    """
    columns = _checked(open_s, mass_mg, "open_s")
    fit = fit_line(columns, mass_mg / density_g_cm3, "weighing", last_digit_mg / density_g_cm3)
    flow = _with_density(fit, density_error / density_g_cm3, "µL/s", "flow")
    lost = fit.estimate(1, "µL").times(1 / flow.value, "s") if columns.shape[1] > 1 else None
    return FlowWeighing(flow, lost, fit.residual)


def _checked(dose: FloatArray, mass_mg: FloatArray, name: str) -> FloatArray:
    """Columns of the fit: the doses, and a loss from each where they differ."""
    if not np.all(dose > 0) or not np.all(mass_mg > 0):
        raise UsageError(
            f"{name} and mass_mg must be above 0 in every row; leave out a dose that failed"
        )
    if float(np.ptp(dose)) < _ALIKE * float(dose.mean()):
        return dose[:, None]
    return np.column_stack([dose, -np.ones(len(dose))])


def _with_density(fit: LineFit, density_share: float, unit: str, what: str) -> Estimate:
    """The slope, its interval widened by that of the density in quadrature."""
    k = fit.estimate(0, unit)
    if k.high - k.value > _MAX_SCATTER * k.value:
        raise UsageError(
            f"{what} is {k.text()}: the doses scatter too much (limit {_MAX_SCATTER:.0%}); check "
            "that each weight stands in its own row and that the balance was tared, or weigh "
            "larger doses"
        )
    half = math.hypot((k.high - k.low) / 2, k.value * density_share)
    return Estimate(k.value, k.value - half, k.value + half, k.unit)
