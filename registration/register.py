"""Scan to report: segment, align, gauge."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics import FlowConditions
from design.network import VesselNetwork
from design.solids.solid import Solid
from registration.alignment import Alignment, AlignmentOptions, Fit, align, cross_check
from registration.distance import ModelSurface
from registration.errors import RegistrationError
from registration.findings import Inspection, inspect
from registration.gauging import (
    TOLERANCES_UM,
    ScannedSurface,
    VesselGauge,
    deviations,
    hausdorff_p95_um,
    summarise,
    surface_points,
    within,
)
from registration.gauging.changes import FALSE_ALARM
from registration.result import RegistrationReport
from registration.scan import Scan
from registration.segmentation import SegmentationOptions, segment
from registration.walls_file import WallCalibration

FloatArray = NDArray[np.float64]

MOST_WORKING_VOXELS = 25_000_000
"""What a segmentation works on, unless 0.1 mm asks for more: a gigabyte and a half."""
HISTOGRAM_EDGES_UM = np.arange(-200.0, 201.0, 5.0)
CROSS_UM = 20.0
"""Of two programs' poses; more is said."""
CURVE_UM = np.concatenate([np.arange(0.0, 100.0, 2.0), np.arange(100.0, 301.0, 10.0)])
"""Tolerances for which the share within is told."""


@dataclass(frozen=True)
class RegistrationOptions:
    """How a scan is registered.

    Attributes
    ----------
    working_voxel_mm : float or None, mm
        Voxels are averaged to about this; None takes an eighth of the thinnest lumen, in OCT a
        twelfth or what a large scan asks for, and at most 0.1 mm.
    smoothing_mm : float or None, mm
        Gaussian; None takes 0.8 of the working voxel.
    lumens : "dark" or "bright"
        Against the gel (micro-CT and confocal).
    section_mm : float or None, mm
        Between sections along a vessel; None takes a quarter of the thinnest lumen.
    tolerances_um : tuple of float, µm
        For which the share of the surface within is told.
    walls : WallCalibration or None
        How far off walls come out in scans of this kind, which is taken out.
    false_alarm : float
        Probability that a scan without defects shows a bulge or a stenosis.
    flow : FlowConditions or None
        What drives the printed network; None for 1 µL/s of water, which gives the same split.
    alignment : AlignmentOptions
        Of the search.
    """

    working_voxel_mm: float | None = None
    smoothing_mm: float | None = None
    lumens: Literal["dark", "bright"] = "dark"
    section_mm: float | None = None
    tolerances_um: tuple[float, ...] = TOLERANCES_UM
    walls: WallCalibration | None = None
    false_alarm: float = FALSE_ALARM
    flow: FlowConditions | None = None
    alignment: AlignmentOptions = field(default_factory=AlignmentOptions)


def register_scan(
    scan: Scan,
    model: Solid,
    network: VesselNetwork,
    options: RegistrationOptions | None = None,
) -> RegistrationReport:
    """Compare a scan with its design.

    Parameters
    ----------
    scan : Scan
        A volume with its units.
    model : Solid
        What was to be printed, in the part's frame: the construct (gel) where its outside is
        scanned too, or the lumens alone. Which of the two it is, is seen from the network: its
        axes lie inside lumens and outside gel.
    network : VesselNetwork
        The vessels, in the part's frame.
    options : RegistrationOptions
        Defaults suit both.

    Raises
    ------
    RegistrationError
        When the scan can't be segmented, doesn't fit the model, or model and network don't
        belong together.
    """
    options = options or RegistrationOptions()
    surface = ModelSurface.of(model)
    is_lumen = _model_is_lumen(surface, network)
    thinnest = 2 * float(network.radius.min())
    segmentation = segment(scan, segmentation_options(scan, options, thinnest))
    points = segmentation.vertices[segmentation.seen]
    blur = segmentation.field.blur_mm
    alignment = align(
        surface,
        points,
        scan.depth_down,
        options.alignment,
        blur_mm=blur,
        depth_standard=scan.depth_standard,
    )
    spread = surface_points(surface)
    scanned = ScannedSurface.of(segmentation)
    rigid, scaled = (
        _both_ways(surface, scanned, fit, spread, is_lumen)
        for fit in (alignment.rigid, alignment.scaled)
    )
    cross = cross_check(surface, spread, points, alignment.scaled)
    found = inspect(
        Inspection(
            network,
            surface,
            is_lumen,
            segmentation,
            alignment,
            scaled.all_mm,
            options.section_mm or thinnest / 4,
            options.false_alarm,
            options.flow,
        )
    )
    seen, limits = segmentation.seen, options.tolerances_um
    return RegistrationReport(
        transform_scan_to_part=alignment.rigid.matrix,
        scaled_scan_to_part=alignment.scaled.matrix,
        scale=alignment.scaled.scale,
        depth_scale_fitted=alignment.depth_fitted,
        offset_um=1e3 * alignment.scaled.offset_mm * (1 if is_lumen else -1),
        margin=alignment.margin,
        ambiguous=alignment.ambiguous,
        uncertainty=alignment.uncertainty,
        cross_check_um=cross,
        rigid=summarise(rigid.there_mm, limits),
        scaled=summarise(scaled.there_mm, limits),
        rigid_back=summarise(rigid.back_mm, limits),
        scaled_back=summarise(scaled.back_mm, limits),
        hausdorff_p95_um=rigid.hausdorff_um,
        scaled_hausdorff_p95_um=scaled.hausdorff_um,
        model_seen_fraction=len(scaled.back_mm) / len(spread),
        vertices=alignment.rigid.apply(segmentation.vertices),
        faces=segmentation.faces,
        deviation_um=1e3 * rigid.all_mm,
        scaled_deviation_um=1e3 * scaled.all_mm,
        seen=seen,
        histogram_edges_um=HISTOGRAM_EDGES_UM,
        histogram_counts=_histogram(scaled.there_mm),
        histogram_counts_rigid=_histogram(rigid.there_mm),
        curve_um=CURVE_UM,
        curve_rigid=_curve(rigid.there_mm),
        curve_scaled=_curve(scaled.there_mm),
        vessels=found.vessels,
        all_open=_all_open(found.vessels),
        defects=found.defects,
        topology=found.topology,
        overlap_rigid=found.overlap_rigid,
        overlap_scaled=found.overlap_scaled,
        perfusion=found.perfusion,
        walls=options.walls,
        notes=(
            *_notes(scan, alignment, found.vessels, float(seen.mean()), cross),
            *_wall_notes(options.walls, found.vessels),
        ),
    )


@dataclass(frozen=True)
class _BothWays:
    """Deviations after one fit, mm: at all scanned vertices, the seen ones, and the way back."""

    all_mm: FloatArray
    there_mm: FloatArray
    back_mm: FloatArray

    @property
    def hausdorff_um(self) -> float:
        return hausdorff_p95_um(self.there_mm, self.back_mm)


def _both_ways(
    surface: ModelSurface, scanned: ScannedSurface, fit: Fit, spread: FloatArray, is_lumen: bool
) -> _BothWays:
    segmentation = scanned.segmentation
    there = deviations(surface, fit.apply(segmentation.vertices), is_lumen)
    return _BothWays(there, there[segmentation.seen], scanned.deviations_back(spread, fit))


def segmentation_options(
    scan: Scan, options: RegistrationOptions, thinnest: float
) -> SegmentationOptions:
    """How a scan is segmented for a design whose thinnest lumen is so wide, mm."""
    fine = thinnest / 8
    if scan.modality == "oct":
        voxel = float(np.prod(scan.geometric_voxel_mm))
        most = (voxel * scan.volume.size / MOST_WORKING_VOXELS) ** (1 / 3)
        fine = max(thinnest / 12, most)
    return SegmentationOptions(
        working_voxel_mm=options.working_voxel_mm or min(0.1, fine),
        smoothing_mm=options.smoothing_mm,
        lumens=options.lumens,
        wall_mm=0.0 if options.walls is None else 1e-3 * options.walls.offset_um,
    )


def _model_is_lumen(surface: ModelSurface, network: VesselNetwork) -> bool:
    """Whether the vessels' axes lie inside the model."""
    start, end, _, _, _ = network.pieces()
    inside = float((surface.query((start + end) / 2).distance < 0).mean())
    if 0.1 < inside < 0.9:
        raise RegistrationError(
            f"{100 * inside:.0f} % of the network's axes lie inside the model: it is neither "
            "lumen (nearly all inside) nor construct (nearly none); give model and network of the "
            "same design, in the same frame"
        )
    return inside >= 0.9


def _histogram(deviation_mm: FloatArray) -> NDArray[np.int64]:
    clipped = np.clip(1e3 * deviation_mm, HISTOGRAM_EDGES_UM[0], HISTOGRAM_EDGES_UM[-1])
    return np.histogram(clipped, HISTOGRAM_EDGES_UM)[0].astype(np.int64)


def _curve(deviation_mm: FloatArray) -> FloatArray:
    """Share within each tolerance of `CURVE_UM`."""
    return np.array([within(deviation_mm, limit) for limit in CURVE_UM])


def _all_open(vessels: tuple[VesselGauge, ...]) -> bool:
    """Every vessel, end to end; what wasn't seen isn't called open."""
    return all(vessel.open is True for vessel in vessels)


def _notes(
    scan: Scan,
    alignment: Alignment,
    vessels: tuple[VesselGauge, ...],
    seen: float,
    cross_um: float | None,
) -> tuple[str, ...]:
    """What a reader must know before trusting the numbers."""
    notes = list(scan.notes)
    if alignment.ambiguous:
        notes.append(
            f"Pose ambiguous: the best wrong pose deviates only {alignment.margin:.2f} times as "
            "much as the best."
        )
    if not alignment.depth_fitted:
        notes.append(
            "Depth scale not fitted: less than 2 mm of depth in view, so it can't be told from an "
            "error of the refractive index."
        )
    elif scan.optical_depth and not scan.depth_standard:
        notes.append(
            f"Depth scale rests on the refractive index {scan.refractive_index:g} of the scan: "
            "shrinkage in depth and an error of the index look the same."
        )
    if cross_um is not None and cross_um > CROSS_UM:
        notes.append(
            f"small_gicp, asked for the same pose, carries a corner of the part {cross_um:.0f} µm "
            f"from ours (usual: below {CROSS_UM:g}): look at both before trusting either."
        )
    if seen < 0.98:
        notes.append(f"{100 * (1 - seen):.0f} % of the surface lies where light failed; left out.")
    closed = [str(vessel.vessel) for vessel in vessels if vessel.open is False]
    unseen = [str(vessel.vessel) for vessel in vessels if vessel.seen_fraction == 0]
    partly = [
        f"{vessel.vessel} ({100 * vessel.seen_fraction:.0f} %)"
        for vessel in vessels
        if 0 < vessel.seen_fraction < 1
    ]
    bare = [str(v.vessel) for v in vessels if v.seen_fraction > 0 and v.sections == 0]
    if closed:
        notes.append(f"Closed vessels: {', '.join(closed)}.")
    if unseen:
        notes.append(f"Vessels not seen, neither open nor closed: {', '.join(unseen)}.")
    if partly:
        notes.append(
            f"Vessels seen in part, of which the rest is neither open nor closed: "
            f"{', '.join(partly)}."
        )
    if bare:
        notes.append(f"No section could be measured in vessels {', '.join(bare)}.")
    return tuple(notes)


def _wall_notes(walls: WallCalibration | None, vessels: tuple[VesselGauge, ...]) -> list[str]:
    """What was taken out of the walls, and for which vessels nobody has shown that it holds."""
    if walls is None:
        return []
    notes = [
        f"Walls were moved {walls.offset_um:+.1f} µm into the gel, the offset of a phantom "
        f"(± {walls.interval_um:.1f} µm; every diameter shares that error twice)."
    ]
    beyond = [
        str(vessel.vessel)
        for vessel in vessels
        if not 0.8 * walls.from_um <= vessel.designed_um <= 1.25 * walls.to_um
    ]
    if beyond:
        notes.append(
            f"The phantom's channels were {walls.from_um:.0f} to {walls.to_um:.0f} µm wide; of "
            f"vessels {', '.join(beyond)} that offset isn't known."
        )
    return notes
