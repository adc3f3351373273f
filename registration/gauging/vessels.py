"""Every vessel along its length: diameter, offset, openness, resistance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.network import VesselKind, VesselNetwork
from registration.alignment import Fit
from registration.gauging.neighbours import Neighbours
from registration.gauging.planes import clearances, stations, to_scan
from registration.gauging.sections import Planes, Sections, cut
from registration.segmentation import Segmentation
from registration.segmentation.volume import sample

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_FREE_WALL = 0.95
"""Less of a wall of its own, and the median of the rays across a section could meet another's."""


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
        Mean diameter over the sections that lie clear of junctions and ends; measured from
        equal area. Of a vessel too short for a clear section: twice the median radius in its
        middle third, where by design at least `_FREE_WALL` of the wall is its own. NaN when
        nothing of the kind is seen.
    error_percent : float
        Of the measured over the designed diameter.
    narrowest_um : float, µm
        Smallest measured diameter; 0 where closed.
    open : bool or None
        Whether every seen section is free somewhere within the designed lumen; None if unseen.
    offset_um : float, µm
        Mean distance of the lumen's centroid from the designed centreline.
    rms_um : float, µm
        RMS deviation of the scanned wall after the scaled fit.
    length_mm : float, mm
        Designed.
    seen_fraction : float
        Share of all sections in the field of view and, in OCT, reached by light.
    sections : int
        Number measured.
    resistance_ratio : float
        Poiseuille resistance as printed over as designed, over the clear sections: the ratio of
        the means of 1/d⁴; inf when closed.
    along_mm, diameter_um : (n,) float64
        The sections measured: distance from the first node, and diameter.
    """

    vessel: int
    kind: str
    designed_um: float
    measured_um: float
    error_percent: float
    narrowest_um: float
    open: bool | None
    offset_um: float
    rms_um: float
    length_mm: float
    seen_fraction: float
    sections: int
    resistance_ratio: float
    along_mm: FloatArray
    diameter_um: FloatArray


def gauge_vessels(
    network: VesselNetwork,
    segmentation: Segmentation,
    fit: Fit,
    deviation_mm: FloatArray,
    spacing_mm: float,
) -> tuple[VesselGauge, ...]:
    """Gauge every vessel of a network in an aligned scan.

    Parameters
    ----------
    network : VesselNetwork
        The design.
    segmentation : Segmentation
        Of the scan.
    fit : Fit
        Scan to part; the scaled one, so that sections follow the print.
    deviation_mm : (n,) float64, mm
        Of the segmentation's vertices after that fit.
    spacing_mm : float, mm
        Between sections.
    """
    clear, neighbours = clearances(network), Neighbours(network)
    rms = _wall_rms(network, segmentation, fit, deviation_mm)
    degree = network.degree()[network.vessel_nodes]
    # An end face is rounded by the smoothing, a junction's rim as well.
    border = 2 * float(segmentation.field.voxel_mm.max())
    trim = np.where(degree > 1, 1.05 * clear + border, 2 * border)
    lengths = network.lengths()
    return tuple(
        _gauge(
            network,
            neighbours,
            vessel,
            segmentation,
            fit,
            trim[vessel],
            spacing_mm,
            rms[vessel],
            lengths,
        )
        for vessel in range(network.vessel_count)
    )


def _gauge(
    network: VesselNetwork,
    neighbours: Neighbours,
    vessel: int,
    segmentation: Segmentation,
    fit: Fit,
    trim: FloatArray,
    spacing: float,
    rms: float,
    lengths: FloatArray,
) -> VesselGauge:
    along, centre, tangent, radius = stations(network, vessel, spacing)
    planes = to_scan(centre, tangent, radius, fit)
    sections = cut(segmentation.field, planes)
    length = float(lengths[vessel])
    apart = (along > trim[0]) & (along < length - trim[1])
    # Within a junction there is no gel around to send light back.
    seen = sections.in_field & (_reached(segmentation, planes) | ~apart)
    counted = seen & apart & (sections.closed_outline | ~sections.open)
    if not apart.any():
        own = neighbours.free_wall(vessel, centre, tangent, radius) >= _FREE_WALL
        sections, counted = _between_junctions(sections, seen & own, along, length)
    return VesselGauge(
        vessel=vessel,
        kind=VesselKind(int(network.kind[vessel])).name.lower(),
        open=bool(sections.open[seen].all()) if seen.any() else None,
        rms_um=float(rms),
        length_mm=length,
        seen_fraction=float(seen.mean()),
        sections=int(counted.sum()),
        along_mm=along[counted],
        diameter_um=1e3 * sections.diameter[counted],
        **_diameters(sections, 2 * radius, counted),
    )


def _between_junctions(
    sections: Sections, seen: BoolArray, along: FloatArray, length: float
) -> tuple[Sections, BoolArray]:
    """For a vessel so short that no section lies clear: its middle third, by median radius.

    Half of the rays must meet the wall; those that look into a neighbour don't sway the median.
    """
    middle = np.abs(along - length / 2) <= length / 6
    counted = seen & middle & ((sections.met >= 0.5) | ~sections.open)
    return replace(sections, diameter=np.where(sections.open, sections.median, 0.0)), counted


def _diameters(sections: Sections, designed: FloatArray, counted: BoolArray) -> dict[str, float]:
    """Numbers over the counted sections; NaN when there are none."""
    if not counted.any():
        names = ("measured_um", "error_percent", "narrowest_um", "offset_um", "resistance_ratio")
        return {"designed_um": 1e3 * float(designed.mean())} | dict.fromkeys(names, float("nan"))
    measured, design = sections.diameter[counted], designed[counted]
    offset = sections.offset[counted]
    found = offset[np.isfinite(offset)]
    with np.errstate(divide="ignore"):
        ratio = float(np.mean(measured**-4.0) / np.mean(design**-4.0))
    return {
        "designed_um": 1e3 * float(design.mean()),
        "measured_um": 1e3 * float(measured.mean()),
        "error_percent": 100 * float(measured.mean() / design.mean() - 1),
        "narrowest_um": 1e3 * float(measured.min()),
        "offset_um": 1e3 * float(found.mean()) if len(found) else float("nan"),
        "resistance_ratio": ratio,
    }


def _reached(segmentation: Segmentation, planes: Planes) -> BoolArray:
    """Whether light came back from the gel around the designed lumen; always, without light."""
    if segmentation.strength is None:
        return np.ones(len(planes.centre), dtype=np.bool_)
    field, strength = segmentation.field, segmentation.strength
    margin = 2 * float(field.voxel_mm.max())
    angle = 2 * np.pi * np.arange(12) / 12
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ring = (planes.radius + margin)[:, None, None] * (circle @ planes.across)
    where = (planes.centre[:, None] + ring - field.origin_mm) / field.voxel_mm
    flat = np.ascontiguousarray(where.reshape(-1, 3))
    around = sample(strength.signal, flat).reshape(where.shape[:2])
    return np.asarray(np.nan_to_num(around).mean(axis=1) > strength.noise)


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
    tree = cKDTree(np.concatenate([part[1] for part in parts]))
    chosen = np.flatnonzero(segmentation.seen)
    away, which = tree.query(fit.apply(segmentation.vertices[chosen]), workers=1)
    wall = np.abs(away - radius[which]) < np.maximum(0.5 * radius[which], 0.1)
    squares = np.bincount(owner[which[wall]], deviation_mm[chosen[wall]] ** 2, len(parts))
    count = np.bincount(owner[which[wall]], minlength=len(parts))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(1e3 * np.sqrt(squares / count))
