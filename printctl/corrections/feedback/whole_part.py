"""Pool values over several prints, and fit the diameter excess common to all lumens."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from kernels.arrays import FloatArray
from printctl.corrections.feedback.readings import LEAST_SECTIONS, Reading

NORMAL_95 = 1.96
BIAS_VOXELS = 0.5
"""Half width of the interval of a segmentation's bias, in voxels, where a registration (of an
earlier version) has no budget that says it."""
OUTLIER = 5.0
"""In standard deviations, from when on a vessel's size is its own and no part of what is common."""
LEAST_FOR_OUTLIERS = 8
"""Vessels; the spread of fewer isn't known well enough to call one of them off."""
_PAIRED = 1000
"""Vessels whose slopes to each other are looked at: pairs grow with the square."""
VESSEL_VOXELS = 0.07
"""Standard deviation from vessel to vessel of that bias: 1.4 to 4 um at 25 to 80 um."""


@dataclass(frozen=True)
class Mean:
    """A value from one or several prints.

    Attributes
    ----------
    value, half : float
        With the half width of its 95 % interval.
    """

    value: float
    half: float

    @property
    def is_real(self) -> bool:
        """Whether the interval leaves 0 out."""
        return bool(abs(self.value) > self.half)


def pool_prints(values: Sequence[float], halves: Sequence[float]) -> Mean:
    """Mean over prints. What one scan can be wrong by, all scans of a scanner can be.

    Their spread tells what differs from print to print (Student's t over the prints); beside it
    stands the measurement's own interval, which doesn't shrink with their number.
    """
    value, own = np.array(values), float(np.sqrt(np.mean(np.square(halves))))
    count = len(value)
    if count == 1:
        return Mean(float(value[0]), own)
    between = -float(stdtrit(count - 1, 0.025)) * float(np.std(value, ddof=1)) / np.sqrt(count)
    return Mean(float(value.mean()), float(np.hypot(own, between)))


@dataclass(frozen=True)
class Radial:
    """By how much all lumens came out too wide, as a function of the designed diameter.

    Attributes
    ----------
    at_mm : float, mm
        Diameter to which `offset` belongs.
    offset : Mean, mm
        Of the diameters.
    slope : Mean, mm/mm
        Of the diameters.
    range_mm : (least, most), mm
        Diameters that were measured.
    """

    at_mm: float
    offset: Mean
    slope: Mean
    range_mm: tuple[float, float]

    def of(self, diameter_mm: float) -> float:
        """The common excess of a lumen's diameter, mm."""
        return self.offset.value + self.slope.value * (diameter_mm - self.at_mm)

    @property
    def is_real(self) -> bool:
        """Whether there is a diameter whose excess' interval leaves 0 out.

        A line is corrected as a whole: its slope about an offset of 0 would do to thin lumens the
        opposite of what was measured of them.
        """
        ends = self.range_mm if self.slope.is_real else (self.at_mm,)
        return any(Mean(self.of(d), self._half(d)).is_real for d in ends)

    def _half(self, diameter_mm: float) -> float:
        return float(np.hypot(self.offset.half, self.slope.half * (diameter_mm - self.at_mm)))

    @property
    def corrected(self) -> tuple[float, float]:
        """Offset (mm) and slope of the diameters' excess that are to be taken back."""
        if not self.is_real:
            return 0.0, 0.0
        return self.offset.value, self.slope.value if self.slope.is_real else 0.0


def radial(prints: Sequence[dict[int, Reading]], voxel_mm: float, bias: Mean) -> Radial:
    """The lumens' common excess, linear in diameter; the slope is 0 where there is one diameter.

    Parameters
    ----------
    prints : sequence of dict of Reading
    voxel_mm : float, mm
        Of the coarsest scan.
    bias : Mean, mm
        Of the scanner's diameters: taken off.
    """
    every = [reading for readings in prints for reading in readings.values()]
    diameters = np.array([reading.diameter_mm for reading in every])
    alike = [_common(_well_measured(readings), voxel_mm) for readings in prints]
    fits = [_line(readings, voxel_mm, float(diameters.mean())) for readings in alike]
    offset = pool_prints([a.value for a, _ in fits], [a.half for a, _ in fits])
    slope = pool_prints([b.value for _, b in fits], [b.half for _, b in fits])
    low, high = float(diameters.min()), float(diameters.max())
    # Blur takes more from thin lumens than from thick ones: the thinnest's bias may differ from the
    # thickest's by as much as it isn't known.
    lean = np.hypot(NORMAL_95 * VESSEL_VOXELS * voxel_mm, bias.half) / max(high - low, 1e-9)
    return Radial(
        at_mm=float(diameters.mean()),
        offset=Mean(offset.value - bias.value, float(np.hypot(offset.half, bias.half))),
        slope=Mean(slope.value, float(np.hypot(slope.half, lean))),
        range_mm=(low, high),
    )


def _well_measured(readings: dict[int, Reading]) -> list[Reading]:
    """The vessels that are told well, where there are some."""
    well = [reading for reading in readings.values() if reading.sections >= LEAST_SECTIONS]
    return well if len(well) >= 3 else list(readings.values())


def _common(readings: list[Reading], voxel_mm: float) -> list[Reading]:
    """Without single vessels that lie far off the others' line: faults and accidents of their own.

    Outliers by the median absolute deviation, from `LEAST_FOR_OUTLIERS` vessels on.
    """
    if len(readings) < LEAST_FOR_OUTLIERS:
        return readings
    x = np.array([reading.diameter_mm for reading in readings])
    y = np.array([reading.excess_mm for reading in readings])
    own = np.array([np.hypot(reading.error_mm, VESSEL_VOXELS * voxel_mm) for reading in readings])
    some = slice(None, None, 1 + len(readings) // _PAIRED)
    slope = _median_slope(x[some], y[some])
    rest = np.abs(y - slope * x - np.median(y - slope * x))
    limit = OUTLIER * np.maximum(own, 1.4826 * float(np.median(rest)))
    return [reading for reading, off in zip(readings, rest > limit, strict=True) if not off]


def _median_slope(x: FloatArray, y: FloatArray) -> float:
    """Of all pairs (Theil 1950; Sen 1968, 10.1080/01621459.1968.10480934); 0 where x is one."""
    first, second = np.triu_indices(len(x), 1)
    run, rise = x[second] - x[first], y[second] - y[first]
    apart = run != 0
    return float(np.median(rise[apart] / run[apart])) if apart.any() else 0.0


def _line(readings: Sequence[Reading], voxel_mm: float, at_mm: float) -> tuple[Mean, Mean]:
    """Weighted line through one print's vessels: value at a diameter, and slope."""
    x = np.array([reading.diameter_mm for reading in readings]) - at_mm
    y = np.array([reading.excess_mm for reading in readings])
    own = (
        np.array([reading.error_mm for reading in readings]) ** 2 + (VESSEL_VOXELS * voxel_mm) ** 2
    )
    sloped = len(np.unique(np.round(x, 3))) >= 3 and len(readings) >= 4
    columns = np.stack([np.ones_like(x), x], axis=1) if sloped else np.ones((len(x), 1))
    extra = 0.0
    for _ in range(30):  # vessels differ by more than their errors: by the method of moments
        weight = 1 / (own + extra)
        normal = columns.T @ (weight[:, None] * columns)
        best = np.linalg.solve(normal, columns.T @ (weight * y))
        rest = y - columns @ best
        free = max(len(y) - columns.shape[1], 1)
        excess = float((weight * rest**2).sum()) / free - 1 if len(y) > columns.shape[1] else 0.0
        extra = max(0.0, extra + excess / float(weight.mean()))
    error = np.sqrt(np.diag(np.linalg.inv(normal)))
    times = -float(stdtrit(max(len(y) - columns.shape[1], 1), 0.025)) if len(y) > 2 else NORMAL_95
    slope = Mean(float(best[1]), times * float(error[1])) if sloped else Mean(0.0, 0.0)
    return Mean(float(best[0]), times * float(error[0])), slope
