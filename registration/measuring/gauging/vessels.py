"""Dimensions of each printed vessel: diameter, offset, open or closed, resistance, seen share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from design.network import VesselKind, VesselNetwork
from kernels.arrays import BoolArray, FloatArray
from registration.alignment import Fit, Uncertainty
from registration.alignment.uncertainty import (
    Budget,
    ScanErrors,
    SectionErrors,
    coverage_factor,
    section_errors,
)
from registration.measuring.gauging.defect import Defect
from registration.measuring.gauging.on_walls import Outlines, near_walls, outlines
from registration.measuring.gauging.sections import (
    LEAST_MET,
    RAYS,
    oval_conductance,
)
from registration.measuring.gauging.trace import VesselTrace, stations
from registration.segmentation import Segmentation

# A wall r₀ + Re(c e^{2iφ}) is 2 (r₀ + |c|) by 2 (r₀ - |c|) wide. One section's c is mostly noise,
# and the length of noise isn't zero: c is averaged, as a vector, over `WINDOW` diameters.
WINDOW = 2.0
"""Diameters: of an oval of 2 : 1 over a third of them 0.24 diameters are left, beyond the 0.2 of a
± 10 % limit; the noise of single sections would pass for as much in lumens of 0.4 mm."""
ALONE = 0.025
"""Probability that a bound of the interval is wrong."""
_TWICE = np.exp(-4j * np.pi * np.arange(RAYS) / RAYS)


@dataclass(frozen=True)
class Oval:
    """Where a lumen is most oval; NaN where no section is whole.

    Attributes
    ----------
    widths_um, u_um : float, µm
        Longest less shortest width beyond the design's, and half width of its 95 % interval.
    at_mm : float, mm
        From the first node.
    """

    widths_um: float
    u_um: float
    at_mm: float


def ovality(trace: VesselTrace, own: SectionErrors, errors: ScanErrors) -> Oval:
    """Return where a lumen is most oval.

    Each component of c has half the variance of the diameter, and the widths differ by 4 |c|.
    Walls across the light err by reflections and index as those along it don't.

    Parameters
    ----------
    trace : VesselTrace
    own : SectionErrors
        Of its counted sections.
    errors : ScanErrors
    """
    counted = np.flatnonzero(trace.counted)
    whole = trace.sections.closed_outline[counted] & own.open
    best, largest = Oval(np.nan, np.nan, np.nan), np.nan
    if trace.short or not whole.any():
        return best
    rays = trace.sections.rays[counted]
    mean = np.nanmean(np.where(whole[:, None], rays, 1.0), axis=1, keepdims=True)
    wall = trace.wall[counted]
    designed = np.where(np.isfinite(wall), wall, trace.designed[counted, None] / 2)
    vector = 2 / RAYS * ((np.where(np.isfinite(rays), rays, mean) - designed) @ _TWICE)
    along, radius = trace.along[counted], trace.radius[counted]
    first, last = along[whole][[0, -1]]
    # Reflections may be of the walls alone that face the light, both of them. A line's place is the
    # mean over walls of three directions, which the difference of two exceeds √(3 · 3/2) times.
    walls = 2 * (errors.faint_mm + errors.facing_mm), 2 * np.sqrt(4.5) * errors.line_mm
    for k in np.flatnonzero(whole).tolist():
        # The window stays within the vessel: fewer sections at its ends would be noisier.
        reach = min(WINDOW * radius[k], (last - first) / 2)
        middle = float(np.clip(along[k], first + reach, last - reach))
        near = whole & (np.abs(along - middle) <= reach + 1e-9)
        weights = near / near.sum()
        noise = np.sqrt(8) * own.averaged(weights)
        widths = np.sqrt(max((4 * abs(weights[near] @ vector[near])) ** 2 - 2 * noise**2, 0.0))
        if not widths <= largest:
            largest = float(widths)
            shared = float(np.linalg.norm([2 * radius[k] * errors.depth, *walls]))
            windows = max(1.0, (last - first) / (2 * max(reach, trace.spacing)))
            best = Oval(*_of_largest(largest, float(noise), shared, windows), middle)
    return best


def _of_largest(value: float, noise: float, shared: float, windows: float) -> tuple[float, float]:
    """Return the middle and half of the 95 % interval of the largest of several values, µm.

    The window that truly is the largest was measured by no more than the largest value, which
    bounds it above as one reading does. Below, each of the windows may be the one whose noise made
    it the largest: all lower bounds hold at once (Šidák 1967), and the greatest is the bound.
    """
    alone = coverage_factor(np.inf)
    any_of = float(ndtri((1 - ALONE) ** (1 / windows)))
    up, down = (float(np.hypot(k * noise, alone * shared)) for k in (alone, any_of))
    low = max(value - down, 0.0)
    return 1e3 * (low + value + up) / 2, 1e3 * (value + up - low) / 2


@dataclass(frozen=True)
class VesselGauge:
    """One vessel as printed, against its design.

    Attributes
    ----------
    vessel : int
        Its number in the network.
    kind : str
        "artery", "vein", ...
    designed_um, measured_um : float, µm
        Mean diameter over the open sections that lie clear of junctions and ends, measured from
        equal area; 0 when all of them are closed. Of a vessel too short for a clear section:
        twice the median radius in its middle third, where by design (nearly) all of the wall is
        its own. NaN when nothing of the kind is seen.
    error_percent : float
        Of the measured over the designed diameter.
    narrowest_um, narrowest_at_mm : float
        Smallest measured diameter, 0 where closed, and how far from the first node it is.
    ovality : float
        Median over the sections, of longest over shortest axis.
    oval_um, oval_u_um, oval_at_mm : float
        Longest less shortest width where that is greatest, half width of its 95 % interval, and
        the place; NaN without a whole section.
    open : bool or None
        False where a seen section is free nowhere within the designed lumen; True where all were
        seen and are free; None where none is closed but not all were seen.
    offset_um : float, µm
        Mean distance of the lumen's centroid from the designed centreline.
    rms_um : float, µm
        RMS deviation of the scanned wall after the scaled fit.
    length_mm : float, mm
        Designed.
    seen_fraction, gauged_fraction : float
        Share of the length in the field of view and, in OCT, reached by light; and share of it
        with a measured section.
    unseen_mm : tuple of (from, to), mm
        Stretches that weren't seen.
    gel_like_mm : tuple of (from, to), mm
        Of these, stretches where something brightens the core of the lumen (`gauging.gel_like`).
    unmeasured_mm : tuple of (from, to), mm
        Stretches clear of junctions that were seen without a wall all round being found.
    sections : int
        Number measured.
    resistance_ratio : float
        Poiseuille resistance as printed over as designed, over the clear sections: the ratio of
        the means of 1/d⁴, times the stretch of the vessel's length; inf when closed, NaN where
        the lumen changes within a junction (`without_resistance`).
    along_mm, diameter_um, area_mm2, ovality_along, offset_along_um, noise_um : (n,) float64
        The sections measured: distance from the first node, diameter, area, ovality, the
        centroid's offset, and the diameter's standard error. NaN where closed (diameter and
        area 0).
    shift_along_um : (n, 3) float64, µm
        That offset as a vector across the vessel, along the part's axes.
    designed_along_um : (n,) float64, µm
        Designed diameter of those sections.
    place_mm : (n, 3) float64, mm
        Their middles on the designed axis, part frame.
    u_um : (n,) float64, µm
        Half width of each diameter's 95 % interval, all terms of its budget; NaN where the section
        is closed or the number is withdrawn.
    measured_u_um, offset_u_um : float, µm
        The same of `measured_um` and `offset_um`.
    resistance_ratio_95 : (low, high)
        95 % interval of `resistance_ratio`; NaN where closed or unknown.
    budget : Budget
        Of `measured_um`, mm.
    errors : SectionErrors
        Of the sections, own and shared.
    outlines : Outlines
        Of the sections, to be drawn.
    """

    vessel: int
    kind: str
    designed_um: float
    measured_um: float
    error_percent: float
    narrowest_um: float
    narrowest_at_mm: float
    ovality: float
    oval_um: float
    oval_u_um: float
    oval_at_mm: float
    open: bool | None
    offset_um: float
    rms_um: float
    length_mm: float
    seen_fraction: float
    gauged_fraction: float
    unseen_mm: tuple[tuple[float, float], ...]
    gel_like_mm: tuple[tuple[float, float], ...]
    unmeasured_mm: tuple[tuple[float, float], ...]
    sections: int
    resistance_ratio: float
    along_mm: FloatArray
    diameter_um: FloatArray
    area_mm2: FloatArray
    ovality_along: FloatArray
    offset_along_um: FloatArray
    noise_um: FloatArray
    shift_along_um: FloatArray
    designed_along_um: FloatArray
    place_mm: FloatArray
    u_um: FloatArray
    measured_u_um: float
    offset_u_um: float
    resistance_ratio_95: tuple[float, float]
    budget: Budget
    errors: SectionErrors
    outlines: Outlines


def gauge_vessels(
    network: VesselNetwork,
    traces: tuple[VesselTrace, ...],
    segmentation: Segmentation,
    fit: Fit,
    deviation_mm: FloatArray,
    errors: ScanErrors,
    pose: Uncertainty,
) -> tuple[VesselGauge, ...]:
    """Sum up the traces of a network's vessels.

    Parameters
    ----------
    network : VesselNetwork
        The design.
    traces : tuple of VesselTrace
        One a vessel, from `trace_vessels`.
    segmentation : Segmentation
        Of the scan.
    fit : Fit
        Scan to part, with which the traces were made.
    deviation_mm : (n,) float64, mm
        Of the segmentation's vertices after that fit.
    errors : ScanErrors
        What all measurements of the scan share.
    pose : Uncertainty
        Of that fit: what offsets share.
    """
    rms = _wall_rms(network, segmentation, fit, deviation_mm)
    return tuple(
        _gauge(
            trace,
            VesselKind(int(network.kind[trace.vessel])),
            float(rms[trace.vessel]),
            fit,
            errors,
            pose,
        )
        for trace in traces
    )


def without_resistance(
    vessels: tuple[VesselGauge, ...], hidden: Sequence[Defect]
) -> tuple[VesselGauge, ...]:
    """Withdraw the resistance ratio of vessels whose lumen changes within a junction.

    The ratio is over whole sections; what narrows a junction isn't in it, and a fifth of a wall
    tells that there is a change, not how wide the lumen is.
    """
    changed = {defect.vessel for defect in hidden} | {defect.other for defect in hidden}
    none = float("nan")
    return tuple(
        replace(v, resistance_ratio=none, resistance_ratio_95=(none, none))
        if v.vessel in changed
        else v
        for v in vessels
    )


def _gauge(
    trace: VesselTrace,
    kind: VesselKind,
    rms: float,
    fit: Fit,
    errors: ScanErrors,
    pose: Uncertainty,
) -> VesselGauge:
    sections, counted = trace.sections, trace.counted
    shift = np.einsum("ni,nij->nj", sections.shift, trace.planes.across) @ fit.rotation.T
    shift = np.where(np.isfinite(sections.offset)[:, None], shift, np.nan)
    own = section_errors(
        errors,
        trace.diameter[counted],
        sections.noise[counted],
        trace.planes.across[counted],
        trace.spacing,
        trace.level_u,
    )
    mean = own.mean_budget()
    stretch = _stretch(trace, fit)
    placed = pose.of_place(trace.centre.mean(axis=0) - fit.centre)
    summary = _summary(trace, stretch)
    oval = ovality(trace, own, errors)
    return VesselGauge(
        vessel=trace.vessel,
        kind=kind.name.lower(),
        oval_um=oval.widths_um,
        oval_u_um=oval.u_um,
        oval_at_mm=oval.at_mm,
        open=_is_open(trace),
        rms_um=rms,
        length_mm=trace.length,
        seen_fraction=float(trace.seen.mean()),
        gauged_fraction=float(counted.mean()),
        unseen_mm=stretches(~trace.seen, trace.spacing),
        gel_like_mm=stretches(trace.gel_like, trace.spacing),
        unmeasured_mm=stretches(unmeasured_stations(trace), trace.spacing),
        sections=int(counted.sum()),
        along_mm=trace.along[counted],
        diameter_um=1e3 * trace.diameter[counted],
        area_mm2=np.pi / 4 * trace.diameter[counted] ** 2,
        ovality_along=sections.ovality[counted],
        offset_along_um=1e3 * sections.offset[counted],
        noise_um=1e3 * sections.noise[counted],
        shift_along_um=1e3 * shift[counted],
        designed_along_um=1e3 * trace.designed[counted],
        place_mm=trace.centre[counted],
        u_um=1e3 * own.expanded,
        measured_u_um=1e3 * mean.expanded,
        offset_u_um=1e3 * float(np.hypot(own.offset_expanded(), placed)),
        resistance_ratio_95=own.resistance_interval(summary["resistance_ratio"]),
        budget=mean,
        errors=own,
        outlines=outlines(trace.planes, sections, trace.diameter, counted),
        **summary,
    )


def _stretch(trace: VesselTrace, fit: Fit) -> float:
    """Return the printed length of a vessel over the designed one, by the fitted scales."""
    way = np.diff(trace.centre, axis=0)
    if len(way) == 0:
        return float(np.mean(fit.scale))
    length = np.linalg.norm(way, axis=1).sum()
    return float(np.linalg.norm(way * fit.scale, axis=1).sum() / max(length, 1e-12))


def unmeasured_stations(trace: VesselTrace) -> BoolArray:
    """Stations that should have a diameter and have none.

    A section may lack as much of the wall that the design has there as one with a diameter may
    lack: in a sharp bend the plane runs along the next leg, and there is no wall all round. A
    single station within a mouth or at the brink of a junction is left to it: its rim is rounded.
    """
    lacking = np.isfinite(trace.wall).mean(axis=1) - trace.sections.met
    missing = trace.seen & trace.own & ~trace.counted & (lacking > 1 - LEAST_MET)
    if not trace.counted.any():
        return np.asarray(missing)
    before = np.concatenate([[False], trace.own[:-1]])
    after = np.concatenate([trace.own[1:], [False]])
    brink = ((~before | ~after) & trace.own) | ~trace.apart
    beside = np.concatenate([[False], missing[:-1]]) | np.concatenate([missing[1:], [False]])
    return np.asarray(missing & ~(brink & ~beside))


def stretches(flags: BoolArray, spacing: float) -> tuple[tuple[float, float], ...]:
    """From and to (mm) of each run of flagged stations, half a spacing to either side."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return tuple(
        (float(first * spacing), float(last * spacing))
        for first, last in edges.reshape(-1, 2).tolist()
    )


def _is_open(trace: VesselTrace) -> bool | None:
    """What is unseen is called neither open nor closed."""
    if (trace.seen & ~trace.sections.open).any():
        return False
    return True if trace.seen.all() else None


def _summary(trace: VesselTrace, stretch: float) -> dict[str, float]:
    """Numbers over the counted sections; NaN when there are none."""
    counted = trace.counted
    if not counted.any():
        names = (
            "measured_um",
            "error_percent",
            "narrowest_um",
            "narrowest_at_mm",
            "ovality",
            "offset_um",
            "resistance_ratio",
        )
        return {"designed_um": 2e3 * float(trace.radius.mean())} | dict.fromkeys(names, np.nan)
    measured, design = trace.diameter[counted], trace.designed[counted]
    free = measured > 0 if (measured > 0).any() else np.ones_like(measured, dtype=np.bool_)
    with np.errstate(divide="ignore"):
        resisting = measured**-4.0 / oval_conductance(trace.sections.ovality[counted])
        ratio = stretch * float(np.mean(resisting) / np.mean(design**-4.0))
    return {
        "designed_um": 1e3 * float(design[free].mean()),
        "measured_um": 1e3 * float(measured[free].mean()),
        "error_percent": 100 * float(measured[free].mean() / design[free].mean() - 1),
        "narrowest_um": 1e3 * float(measured.min()),
        "narrowest_at_mm": float(trace.along[counted][measured.argmin()]),
        "ovality": float(np.median(_finite(trace.sections.ovality[counted]))),
        "offset_um": 1e3 * float(_finite(trace.sections.offset[counted]).mean()),
        "resistance_ratio": ratio,
    }


def _finite(values: FloatArray) -> FloatArray:
    """Those that are finite, or one NaN."""
    finite = values[np.isfinite(values)]
    return finite if len(finite) else np.array([np.nan])


def _wall_rms(
    network: VesselNetwork, segmentation: Segmentation, fit: Fit, deviation_mm: FloatArray
) -> FloatArray:
    """RMS deviation of the wall of each vessel, (v,), µm; NaN without wall points.

    A surface point belongs to the vessel whose axis is nearest, if its distance is that of the
    wall within half a radius (at least 0.1 mm).
    """
    spacing = max(0.05, float(network.radius.min()) / 2)
    parts = [stations(network, v, spacing) for v in range(network.vessel_count)]
    owner = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
    radius = np.concatenate([part[3] for part in parts])
    centre = np.concatenate([part[1] for part in parts])
    chosen = np.flatnonzero(segmentation.seen)
    which, wall = near_walls(centre, radius, fit.apply(segmentation.surface.vertices[chosen]))
    squares = np.bincount(owner[which[wall]], deviation_mm[chosen[wall]] ** 2, len(parts))
    count = np.bincount(owner[which[wall]], minlength=len(parts))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(1e3 * np.sqrt(squares / count))
