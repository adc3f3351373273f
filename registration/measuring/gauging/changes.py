"""Find bulges and stenoses: runs of sections wider or narrower than their vessel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import erf, pi, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from kernels.arrays import BoolArray, FloatArray
from registration.alignment.uncertainty import rectangular
from registration.measuring.gauging.defect import Defect
from registration.measuring.gauging.sections import RAYS
from registration.measuring.gauging.trace import VesselTrace

_MAD = 1.4826
"""Standard deviation over median absolute deviation, of normal noise."""
_SECOND = np.sqrt(1.5)
"""Standard deviation of x_i - (x_(i-1) + x_(i+1))/2 over that of x, of independent noise."""
_LEAST = 8
"""Differences from which a vessel's own scatter is told; with fewer, all vessels' counts."""


def second_differences(values: FloatArray, lag: int = 1) -> FloatArray:
    """Return x_i - (x_(i-lag) + x_(i+lag)) / 2 along the first axis, scaled to the noise of x."""
    inner = values[lag:-lag] - (values[: -2 * lag] + values[2 * lag :]) / 2
    return np.asarray(inner / _SECOND)


def scatter(values: FloatArray, lag: int = 1) -> float:
    """Standard deviation of independent noise, by second differences; NaN where too few."""
    if len(values) < 2 * lag + 1:
        return float("nan")
    fine = second_differences(values, lag)
    fine = fine[np.isfinite(fine)]
    return float(_MAD * np.median(np.abs(fine))) if len(fine) >= _LEAST else float("nan")


_LEAST_KEPT = 0.5
"""Part of its height that a change keeps at least: of one narrower than 1.6 times the blur nothing
tells how high it was."""


@dataclass(frozen=True)
class Peak:
    """Where a change is largest, and by how much.

    Attributes
    ----------
    height : float, mm
        Signed, before the blur.
    along : float, mm
        From the vessel's first node.
    standard : float, mm
        Standard uncertainty of the height by the change's unknown shape, noise apart.
    """

    height: float
    along: float
    standard: float


def peak_of(change: FloatArray, along: FloatArray, worst: int, blur_mm: float) -> Peak:
    """Return the peak at a station.

    A Gaussian blur σ along a vessel lowers a change of the width w at half height to
    erf(w / (2 √2 σ)) of its height where its top is flat and its ends are steep, to
    1 - √(2 / π) σ / w where it is pointed with straight flanks (the mean of |x| is √(2 / π) σ);
    bells lie between. A flat top is as high as the highest station, another as the parabola
    through three or as where the flanks meet. What is in between is as likely as the ends
    (GUM 4.3.7).

    Parameters
    ----------
    change, along : (n,) float64, mm
        Evenly spaced; NaN where not measured.
    worst : int
        The station.
    blur_mm : float, mm
        Standard deviation of the field's blur.
    """
    here = float(change[worst])
    top, place = _parabola(change, along, worst)
    width = _width(change / top if top else change, along, worst)
    flat, pointed = _kept(width, blur_mm)
    tip = max(top, _tip(change, along, worst, width), key=abs) if blur_mm > 0 else top
    ends = here / flat, tip / pointed
    return Peak(sum(ends) / 2, place, rectangular(abs(ends[1] - ends[0]) / 2))


def _parabola(change: FloatArray, along: FloatArray, worst: int) -> tuple[float, float]:
    """Height and place of the vertex through three stations; beside a gap the station itself."""
    here = float(change[worst]), float(along[worst])
    if not 0 < worst < len(change) - 1:
        return here
    before, top, after = change[worst - 1 : worst + 2].tolist()
    bend = before - 2 * top + after
    # NaN compares false.
    if not (abs(top) >= max(abs(before), abs(after)) and bend * top < 0):
        return here
    shift = 0.5 * (before - after) / bend
    return top - 0.25 * (before - after) * shift, here[1] + shift * float(along[1] - along[0])


def _tip(change: FloatArray, along: FloatArray, worst: int, width: float) -> float:
    """Height where straight flanks through a station's neighbours meet.

    A tip δ beside the station makes its neighbours differ by 2 δ of the flanks' slope; δ is no more
    than half a spacing, the slope the height over the width at half height.
    """
    here = float(change[worst])
    if not (0 < worst < len(change) - 1 and np.isfinite(width)):
        return here
    apart = abs(float(change[worst + 1] - change[worst - 1])) / 2
    most = abs(here) * float(along[1] - along[0]) / (2 * width)
    return here + float(np.copysign(min(apart, most), here)) if np.isfinite(apart) else here


def _width(part: FloatArray, along: FloatArray, worst: int) -> float:
    """Full width at half height of parts of a height, mm; inf where no end was measured."""
    step = float(along[1] - along[0])
    return step * (_half_way(part[worst:]) + _half_way(part[worst::-1]))


def _half_way(part: FloatArray) -> float:
    """Stations to where parts of the height fall below a half; inf where they don't.

    Two in a row must lie below: one alone may be noise within a long change.
    """
    low = part < 0.5
    ends = np.flatnonzero(low[:-1] & (low[1:] | np.isnan(part[1:])))
    if len(ends) == 0:
        return float("inf")
    end = int(ends[0])
    return float(end - 1 + (part[end - 1] - 0.5) / (part[end - 1] - part[end]))


def _kept(width: float, blur_mm: float) -> tuple[float, float]:
    """Parts of their height that a flat-topped and a pointed change of a measured width keep."""
    if blur_mm <= 0 or not np.isfinite(width):
        return 1.0, 1.0
    flat = erf(width / (2 * sqrt(2) * blur_mm))
    pointed = 1 - sqrt(2 / pi) * blur_mm / width
    return max(flat, _LEAST_KEPT), max(pointed, _LEAST_KEPT)


FALSE_ALARM = 1e-3
"""Probability that a scan without defects shows one."""
_POOLED_WEIGHT = 20
"""A vessel's own scatter counts as much as that of all vessels when it has so many sections."""
_SECTOR = 5
"""Rays averaged where one side of the wall is looked at: 37 degrees."""
_MIN_SECTIONS = 5
"""Sections below which a vessel has no median of its own to be held against."""
_MAD_WORTH = 0.37
"""... and how many sections' worth of a standard deviation each section is in it."""
_LAG = 3
"""Sections between differences: averages of three share none, and a blur reaches less far."""
LEAST_SCATTER_MM = 1e-4
"""Designed walls are known to so much (`gauging.designed`): a scan without noise isn't surer."""
_QUARTER = 0.6745
"""Quartile of normal noise, standard deviations."""


@dataclass(frozen=True)
class _Series:
    """One vessel's stations less what its rest is like; NaN where there is no outline.

    Attributes
    ----------
    trace : VesselTrace
    change, noise : (n,) float64, mm
        Of the diameter, and its standard error.
    base : float, mm
        Measured less designed diameter of the vessel where it isn't changed.
    wall : (n, `RAYS`) float64, mm
        Displacement of the wall about the vessel's axis, averaged over a sector.
    score, side : (n,), (n, `RAYS`) float64
        Change, and displacement of the wall about the section's own centroid (a lumen that
        wanders isn't a bulge), averaged over three stations, over the scatter of that.
    threshold : float
        Of both.
    blur_mm : float, mm
        Of the field, as standard deviation.
    """

    trace: VesselTrace
    change: FloatArray
    noise: FloatArray
    base: float
    wall: FloatArray
    score: FloatArray
    side: FloatArray
    threshold: float
    blur_mm: float = 0.0


def find_changes(
    traces: tuple[VesselTrace, ...],
    scale: float,
    false_alarm: float = FALSE_ALARM,
    blur_mm: float = 0.0,
) -> list[Defect]:
    """Bulges and stenoses of all vessels.

    Parameters
    ----------
    traces : tuple of VesselTrace
        One a vessel.
    scale : float
        Size of the print over that of the design across the vessels, as the fit found it.
    false_alarm : float
        Probability that a scan without defects shows one.
    blur_mm : float, mm
        Standard deviation of the field's blur, which lowers short changes.
    """
    series = _series(traces, scale, false_alarm)
    return [d for each in series for d in _defects(replace(each, blur_mm=blur_mm))]


def _series(traces: tuple[VesselTrace, ...], scale: float, false_alarm: float) -> list[_Series]:
    offsets = [_offset(trace, scale) for trace in traces]
    usable = [
        (trace, offset)
        for trace, offset in zip(traces, offsets, strict=True)
        if not trace.short and np.isfinite(offset).sum() >= _MIN_SECTIONS
    ]
    if not usable:
        return []
    count = np.array([np.isfinite(offset).sum() for _, offset in usable])
    # Each station is tested once for its diameter and once for each sector of its wall.
    chance = false_alarm / (2 * count.sum() * (1 + RAYS / _SECTOR))
    worth = _MAD_WORTH * (count + _POOLED_WEIGHT)
    threshold = -stdtrit(worth, chance)
    bases = _bases([offset for _, offset in usable])
    changes = [offset - base for (_, offset), base in zip(usable, bases, strict=True)]
    walls = [_walls(trace, np.isfinite(offset), scale) for trace, offset in usable]
    ratios = [
        change / np.maximum(trace.sections.noise, 1e-6)
        for (trace, _), change in zip(usable, changes, strict=True)
    ]
    single = _scatter(ratios, count)
    scores = _scores(ratios, count)
    sides = _scores([about_centroid for about_centroid, _ in walls], count)
    noise = [
        k * trace.sections.noise
        for (trace, _), k in zip(usable, np.maximum(single, 1.0), strict=True)
    ]
    limits = threshold.tolist()
    return [
        _Series(trace, changes[n], noise[n], bases[n], walls[n][1], scores[n], sides[n], limits[n])
        for n, (trace, _) in enumerate(usable)
    ]


def _offset(trace: VesselTrace, scale: float) -> FloatArray:
    """Measured less designed diameter at each station, mm; NaN without an outline."""
    measured = np.where(trace.sections.open, trace.diameter, np.nan)
    return np.asarray(measured - scale * trace.designed)


def _bases(offsets: list[FloatArray]) -> list[float]:
    """What each vessel's sections are held against: its own usual offset, or that of all vessels.

    A vessel whose median lies far out among the others' is changed over most of its length; its
    own median would hide that. The others' spread decides what is far; it takes four vessels.
    Of a vessel that is two ways, changed over half of its length, the side that is more like the
    other vessels counts.
    """
    medians = np.array([np.nanmedian(offset) for offset in offsets])
    common = float(np.median(medians))
    fine = np.array([scatter(offset) for offset in offsets])
    grain = float(np.nanmedian(fine)) if np.isfinite(fine).any() else 0.0
    own = [
        _side(offset, common, float(sd))
        for offset, sd in zip(offsets, np.fmax(fine, grain), strict=True)
    ]
    if len(medians) < 4:
        return own
    spread = _MAD * float(np.median(np.abs(medians - common)))
    threshold = -stdtrit(len(medians) - 1, FALSE_ALARM / (2 * len(medians)))
    # So few vessels tell the spread badly: never less than one section's scatter.
    far = np.abs(medians - common) > threshold * max(spread, grain / 2)
    return np.where(far, common, own).tolist()


def _side(offset: FloatArray, common: float, sd: float) -> float:
    """Median of a vessel's offsets; of one that is two ways the side nearer to `common`.

    Between the quartiles, each moved in by what noise moves it out, there is nothing but the
    median of a vessel that is one way.
    """
    low, middle, high = np.nanquantile(offset, [0.25, 0.5, 0.75]).tolist()
    low, high = low + _QUARTER * sd, high - _QUARTER * sd
    if high - low < 2 * sd:
        return float(middle)
    return float(np.clip(common, low, high))


def _scatter(values: list[FloatArray], count: NDArray[np.int64]) -> FloatArray:
    """Noise of each vessel's values by differences of neighbours; shared where few.

    Shared with the median vessel, not the median section: one long changed vessel mustn't deafen
    the rest.
    """
    own = np.array([scatter(value) for value in values])
    pooled = float(np.nanmedian(own)) if np.isfinite(own).any() else 1.0
    own = np.minimum(np.where(np.isfinite(own), own, pooled), 4 * pooled)
    mixed = (count * own**2 + _POOLED_WEIGHT * pooled**2) / (count + _POOLED_WEIGHT)
    return np.asarray(np.sqrt(mixed))


def _scores(values: list[FloatArray], count: NDArray[np.int64]) -> list[FloatArray]:
    """Values averaged over three stations, over the scatter of such averages.

    A defect is longer than a station; noise isn't, and an average has fewer outliers. By how much
    averages scatter less than single values follows from how neighbours err alike; the median
    vessel tells that, by averages that share no station.
    """
    means = [_over_three(value) for value in values]
    less = [
        scatter(mean, _LAG) / max(scatter(value), 1e-9)
        for mean, value in zip(means, values, strict=True)
    ]
    known = [ratio for ratio in less if np.isfinite(ratio)]
    ratio = max(float(np.median(known)), 3**-0.5) if known else 1.0
    noise = np.maximum(ratio * _scatter(values, count), LEAST_SCATTER_MM)
    return [mean / k for mean, k in zip(means, noise, strict=True)]


def _over_three(values: FloatArray) -> FloatArray:
    """Running mean along the first axis over those of three that are known, at least two."""
    edge = np.full((1, *values.shape[1:]), np.nan)
    near = np.stack(
        [np.concatenate([edge, values[:-1]]), values, np.concatenate([values[1:], edge])]
    )
    known = np.isfinite(near)
    enough = (known.sum(axis=0) >= 2) & known[1]
    total = np.where(known, near, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return np.where(enough, total, np.nan)


def _walls(trace: VesselTrace, there: BoolArray, scale: float) -> tuple[FloatArray, FloatArray]:
    """The wall's displacement about the centroid and about the axis, less each side's usual one."""
    angle = 2 * np.pi * np.arange(RAYS) / RAYS
    circle = np.stack([np.cos(angle), np.sin(angle)])
    wall = scale * np.where(np.isfinite(trace.wall), trace.wall, trace.designed[:, None] / 2)
    aside = 2 / RAYS * (wall @ circle.T) @ circle
    shift = trace.sections.shift @ circle
    rays = trace.sections.rays
    return _sectors(rays - (wall - aside), there), _sectors(rays + shift - wall, there)


def _sectors(rays: FloatArray, there: BoolArray) -> FloatArray:
    """Less each ray's median along the vessel, then averaged over a sector."""
    rays = np.where(there[:, None], rays, np.nan)
    known = [ray[np.isfinite(ray)] for ray in rays.T]
    rays = rays - np.array([np.median(ray) if len(ray) else np.nan for ray in known])
    half = _SECTOR // 2
    around = np.concatenate([rays[:, -half:], rays, rays[:, :half]], axis=1)
    windows = np.lib.stride_tricks.sliding_window_view(around, _SECTOR, axis=1)
    return np.asarray(windows.mean(axis=-1))


def _defects(series: _Series) -> list[Defect]:
    out = []
    for sign in (1, -1):
        flags = sign * np.nan_to_num(series.score) > series.threshold
        flags |= (sign * np.nan_to_num(series.side) > series.threshold).any(axis=1)
        out += [_defect(series, sign, run) for run in _runs(flags)]
    # A step from a narrow to a wide stretch looks like both; of two that overlap the stronger.
    out.sort(key=lambda defect: -defect.significance)
    kept: list[Defect] = []
    for defect in out:
        if all(defect.to_mm <= d.from_mm or defect.from_mm >= d.to_mm for d in kept):
            kept.append(defect)
    return kept


def _runs(flags: BoolArray) -> list[NDArray[np.int64]]:
    """Stations of each run of flagged ones, gaps of one closed."""
    flagged = np.flatnonzero(flags)
    if len(flagged) == 0:
        return []
    return np.split(flagged, np.flatnonzero(np.diff(flagged) > 2) + 1)


def _defect(series: _Series, sign: int, run: NDArray[np.int64]) -> Defect:
    trace = series.trace
    score = sign * np.nan_to_num(series.score[run])
    side = (sign * np.nan_to_num(series.side[run])).max(axis=1)
    wall = (sign * np.nan_to_num(series.wall[run])).max(axis=1)
    if score.max() >= side.max():
        worst = int(run[np.argmax(sign * np.nan_to_num(series.change[run]))])
    else:
        worst = int(run[np.argmax(wall)])
    peak = peak_of(series.change, trace.along, worst, series.blur_mm)
    size, along = peak.height, peak.along
    if sign * size < 0:
        # Of an oval, walls stand out to both sides: what it is its area says.
        sign = -sign
        wall = (sign * np.nan_to_num(series.wall[run])).max(axis=1)
    rest = float(trace.designed[worst]) + series.base
    half = trace.spacing / 2
    extent = float(trace.along[run[0]]) - half, float(trace.along[run[-1]]) + half
    return Defect(
        kind="bulge" if sign > 0 else "stenosis",
        vessel=trace.vessel,
        other=None,
        from_mm=extent[0],
        to_mm=extent[1],
        at_mm=along,
        point_mm=point_at(trace, along),
        size_um=1e3 * size,
        error_um=1.96e3 * float(np.hypot(series.noise[worst], peak.standard)),
        percent=100 * size / rest,
        wall_um=1e3 * sign * float(wall.max()),
        significance=float(max(score.max(), side.max())),
        seen=bordered(trace, extent),
    )


def point_at(trace: VesselTrace, along: float) -> tuple[float, float, float]:
    """Place on the designed axis, part frame, mm."""
    x, y, z = (float(np.interp(along, trace.along, trace.centre[:, k])) for k in range(3))
    return (x, y, z)


def bordered(trace: VesselTrace, extent: tuple[float, float]) -> bool:
    """Whether an extent and one section to either side were seen."""
    reach = 1.5 * trace.spacing
    around = (trace.along > extent[0] - reach) & (trace.along < extent[1] + reach)
    return bool(trace.seen[around].all())


def drop_edge_changes(
    changes: Sequence[Defect], others: Sequence[Defect], traces: Sequence[VesselTrace]
) -> list[Defect]:
    """Return the changes that lie beside none of the other defects, within two sections."""
    return [
        change
        for change in changes
        if not any(_beside(change, other, traces[change.vessel]) for other in others)
    ]


def _beside(change: Defect, other: Defect, trace: VesselTrace) -> bool:
    if change.vessel not in (other.vessel, other.other):
        return False
    (low, high), reach = _extent(other, trace), 2 * trace.spacing
    return change.from_mm < high + reach and change.to_mm > low - reach


def _extent(defect: Defect, trace: VesselTrace) -> tuple[float, float]:
    """Where a defect lies along a vessel, mm; a bridge's other end about the nearest place."""
    if trace.vessel == defect.vessel:
        return defect.from_mm, defect.to_mm
    away = np.linalg.norm(trace.centre - np.array(defect.point_mm), axis=1)
    at, half = float(trace.along[np.argmin(away)]), 0.5e-3 * defect.size_um
    return at - half, at + half
