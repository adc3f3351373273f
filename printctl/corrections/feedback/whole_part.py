"""Pool several prints: diameter excess common to all lumens, and the part's size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from printctl.corrections.feedback.evidence import LEAST_SECTIONS, Print, Reading

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


# A scale that is fitted to the surface takes walls that moved (lines that spread, a scanner's bias)
# for size: 20 um on either face of 8 mm are half a percent. A lumen's axis stays where it is when
# its walls move alike, so the way from one lumen to another tells shrinkage by itself.
OFFSET_VOXELS = 0.1
"""Standard deviation of a lumen's place that repeats in every scan: one wall is lit otherwise than
the one opposite (`registration.alignment.intervals`), by 2 to 5 um at 25 um."""
GOOD_ENOUGH = 0.003
"""Half width of the interval up to which lumens decide."""
_SHIFT_PRIOR_MM, _SIZE_PRIOR = 0.1, 0.05
UNKNOWN = 0.1
"""Half width for a scale whose interval was withdrawn: what is off by more is refused."""


@dataclass(frozen=True)
class Size:
    """One print's size over the design's.

    Attributes
    ----------
    scale, half : (3,) float64
        Along x, y, z, and half widths of the 95 % intervals.
    by_lumens : (3,) bool
        Whether the lumens' places told it; else the surface did.
    shift_mm : (3,) float64, mm
        Of all lumens together against the surface.
    growth : (3,) float64
        What the lumens' places add to the registration's scale.
    """

    scale: FloatArray
    half: FloatArray
    by_lumens: NDArray[np.bool_]
    shift_mm: FloatArray
    growth: FloatArray

    def explains(self, places: FloatArray, about: FloatArray) -> FloatArray:
        """Offset from where registration put the axes, of places (n, 3), mm."""
        return np.asarray(self.shift_mm + self.growth * (places - about))


def size_of(
    print_: Print, per_vessel: dict[int, Reading], about: FloatArray, voxel_mm: float
) -> Size:
    """A print's size.

    Parameters
    ----------
    print_ : Print
    per_vessel : dict of Reading
    about : (3,) float64, mm
        The part's middle.
    voxel_mm : float, mm
    """
    scale = np.array(print_.facts.scale)
    surface = _surface_half(print_)
    low, high = np.array(print_.design.bounds_mm)
    if "budget" not in print_.found:
        surface = np.hypot(surface, BIAS_VOXELS * voxel_mm / ((high - low) / 2))
    best, error = _fit(print_.network, per_vessel, about, voxel_mm)
    half = NORMAL_95 * error[3:]
    by_lumens = half < GOOD_ENOUGH
    growth = np.where(by_lumens, best[3:], 0.0)
    return Size(
        scale=scale * (1 + growth),
        half=np.where(by_lumens, half, surface),
        by_lumens=by_lumens,
        shift_mm=best[:3],
        growth=growth,
    )


def _surface_half(print_: Print) -> FloatArray:
    """Half widths of the fitted scales' intervals, (3,).

    A scale that was fitted without an interval isn't known; one that wasn't fitted is 1 by decree.
    """
    return np.array([
        half if half is not None else 0.0 if scale == 1.0 else UNKNOWN
        for scale, half in zip(print_.facts.scale, print_.facts.scale_interval_95, strict=True)
    ])  # fmt: skip


def without_size(reading: Reading, print_: Print, size: Size, about: FloatArray) -> Reading:
    """A reading without what the print's size explains of its axis' offset."""
    if reading.ends_mm is None:
        return reading
    nodes = print_.network.nodes[print_.network.vessel_nodes[reading.vessel]]
    return replace(reading, ends_mm=reading.ends_mm - size.explains(nodes, about))


def projector_across(network: VesselNetwork, vessel: int, end: int) -> FloatArray:
    """Projector (3, 3) onto the plane across a vessel's first (0) or last (1) end."""
    points, _ = network.polyline(vessel)
    way = points[1] - points[0] if end == 0 else points[-1] - points[-2]
    way = way / np.linalg.norm(way)
    return np.asarray(np.eye(3) - np.outer(way, way))


def _fit(
    network: VesselNetwork, per_vessel: dict[int, Reading], about: FloatArray, voxel_mm: float
) -> tuple[FloatArray, FloatArray]:
    """Shift and growth (6,) that explain the vessels' offsets best, and standard errors.

    What single lumens are off beside that widens the errors (method of moments).
    """
    rows, values, errors = [], [], []
    for vessel, reading in per_vessel.items():
        if reading.ends_mm is None:
            continue
        for end in (0, 1):
            plane = projector_across(network, vessel, end)
            place = network.nodes[network.vessel_nodes[vessel, end]] - about
            rows.append(plane @ np.hstack([np.eye(3), np.diag(place)]))
            values.append(plane @ reading.ends_mm[end])
            errors.append(float(reading.ends_error_mm[end]))
    prior = np.diag(1 / np.array([_SHIFT_PRIOR_MM] * 3 + [_SIZE_PRIOR] * 3) ** 2)
    if not rows:
        return np.zeros(6), np.sqrt(1 / np.diag(prior))
    columns, offset = np.concatenate(rows), np.concatenate(values)
    own = np.repeat(np.array(errors) ** 2 + (OFFSET_VOXELS * voxel_mm) ** 2, 3)
    free = max(2 * len(rows) - 6, 1)  # a plane has two directions
    extra = 0.0
    for _ in range(30):
        weight = 1 / (own + extra)
        normal = columns.T @ (weight[:, None] * columns) + prior
        best = np.linalg.solve(normal, columns.T @ (weight * offset))
        excess = float((weight * (offset - columns @ best) ** 2).sum()) / free - 1
        extra = max(0.0, extra + excess / float(weight.mean()))
    return best, np.sqrt(np.diag(np.linalg.inv(normal)))
