"""Measured sections of one vessel as arrays with their noise, for judging."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray
from registration.json_ready import Record
from registration.measuring.gauging.changes import scatter
from registration.measuring.judging.decisions import COVERAGE


def random_um(errors: Sequence[FloatArray], noise: Sequence[FloatArray]) -> list[FloatArray]:
    """Standard uncertainty of each section of each vessel by noise alone, µm.

    A stenosis over half a vessel widens the spread about the vessel's median, and would hide
    itself. Two estimates don't see it: the scatter of a section's own rays, and differences of
    neighbouring sections. The larger of both counts.

    Parameters
    ----------
    errors : sequence of (n,) float64, µm
        Measured less designed diameters of each vessel, in order along it; NaN where closed.
    noise : sequence of (n,) float64, µm
        Standard errors by the scatter of each section's rays; NaN where it has no outline.
    """
    fine = [scatter(error) for error in errors]
    known = [value for value in fine if np.isfinite(value)]
    pooled = float(np.median(known)) if known else 0.0
    return [
        np.asarray(np.fmax(rays, own if np.isfinite(own) else pooled))
        for rays, own in zip(noise, fine, strict=True)
    ]


@dataclass(frozen=True)
class Series:
    """The measured sections of one vessel; (n,) float64 each.

    Attributes
    ----------
    vessel : int
    along_mm : mm
        From the first node.
    place_mm : (n, 3), mm
        On the designed axis, part frame.
    designed_um, measured_um : µm
        Diameter; measured 0 where closed.
    u_um : µm
        Half width of the measured diameter's 95 % interval; NaN where withdrawn.
    common_um, random_um : µm
        Standard uncertainty that the sections share, and each section's own.
    """

    vessel: int
    along_mm: FloatArray
    place_mm: FloatArray
    designed_um: FloatArray
    measured_um: FloatArray
    u_um: FloatArray
    common_um: FloatArray
    random_um: FloatArray

    @property
    def error_um(self) -> FloatArray:
        """Measured less designed diameter."""
        return self.measured_um - self.designed_um

    @property
    def spacing_mm(self) -> float:
        """Usual distance of neighbouring sections; 0 of a single one."""
        return float(np.median(np.diff(self.along_mm))) if len(self.along_mm) > 1 else 0.0


def series_of(rows: Sequence[Record]) -> list[Series]:
    """Read the sections of all vessels, with their uncertainties.

    Raises
    ------
    KeyError
        When a row states no intervals or no designed diameters: an older version wrote it.
    """
    noise = random_um([_errors(row) for row in rows], [numbers(row, "noise_um") for row in rows])
    return [_series(row, own) for row, own in zip(rows, noise, strict=True)]


def _errors(row: Record) -> FloatArray:
    measured = numbers(row, "diameter_um")
    return np.where(measured > 0, measured - numbers(row, "designed_along_um"), np.nan)


def _series(row: Record, random: FloatArray) -> Series:
    half = numbers(row, "interval_95_um")
    return Series(
        vessel=int(row["vessel"]),
        along_mm=numbers(row, "along_mm"),
        place_mm=np.array(row["place_mm"], dtype=np.float64).reshape(-1, 3),
        designed_um=numbers(row, "designed_along_um"),
        measured_um=numbers(row, "diameter_um"),
        u_um=half,
        common_um=_shared(row, half / COVERAGE),
        random_um=random,
    )


def _shared(row: Record, standard: FloatArray) -> FloatArray:
    """Standard uncertainty that a vessel's sections share, at most.

    That of their mean, where it is stated, holds all of it. Else it may be all of each section's
    own: to take the noise out of that would leave too little where the noise is overestimated.
    """
    mean = row.get("measured_interval_95_um")
    return standard if mean is None else np.fmin(standard, float(mean) / COVERAGE)


def numbers(row: Record, name: str) -> FloatArray:
    """Return a list of a row as an array; what isn't known is NaN."""
    return np.array([np.nan if v is None else v for v in row[name]], dtype=np.float64)
