"""Build the registration report object from segmentation, pose, deviations and findings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.alignment import Alignment
from registration.alignment.as_printed import AsPrinted
from registration.alignment.uncertainty import ScanErrors
from registration.findings import Findings
from registration.measuring.gauging import hausdorff_p95_um, summarise
from registration.measuring.gauging.deviation import (
    CURVE_UM,
    HISTOGRAM_EDGES_UM,
    histogram,
    within_curve,
)
from registration.measuring.gauging.openings.face_places import FacePlace
from registration.measuring.gauging.resolution import needed_voxel_um
from registration.measuring.geometry import Characteristic, Frame
from registration.measuring.topology import Agreement
from registration.notes import (
    contrast_notes,
    pose_notes,
    sight_notes,
    step_notes,
    uneven_notes,
    wall_notes,
)
from registration.options import RegistrationOptions
from registration.result import RegistrationReport
from registration.scan import Scan
from registration.segmentation import Segmentation


@dataclass(frozen=True)
class FitDeviations:
    """Deviations after one fit, mm: at all scanned vertices, the seen ones, and the way back."""

    all_mm: FloatArray
    there_mm: FloatArray
    back_mm: FloatArray

    @property
    def hausdorff_um(self) -> float:
        """The larger of both directions' 95th percentiles, µm."""
        return hausdorff_p95_um(self.there_mm, self.back_mm)


@dataclass(frozen=True)
class RegistrationParts:
    """What segmentation, alignment and gauging gave.

    Attributes
    ----------
    size_mm : (3,) float64, mm
        Of the model.
    is_lumen : bool
        The model is the lumens, not the gel around them.
    cross_um : float or None, µm
        Between our pose and another program's.
    spread : int
        Points on the design from which the scanned surface was looked for.
    places : tuple of FacePlace
        Where the surface away from lumens stands out.
    gel_at : (p,) float64 or None
        At the options' places: 1 for gel, 0 for none, NaN where it can't be told.
    agreement : Agreement
        Whether the scan is of this part at all.
    printed : AsPrinted
        What became of the print, as far as that explains a misfit.
    """

    segmentation: Segmentation
    alignment: Alignment
    size_mm: FloatArray
    is_lumen: bool
    cross_um: float | None
    spread: int
    places: tuple[FacePlace, ...]
    rigid: FitDeviations
    scaled: FitDeviations
    findings: Findings
    frame: Frame
    characteristics: tuple[Characteristic, ...]
    errors: ScanErrors
    gel_at: FloatArray | None
    agreement: Agreement
    printed: AsPrinted


def assemble(
    parts: RegistrationParts, scan: Scan, options: RegistrationOptions
) -> RegistrationReport:
    """Put all numbers into the units and signs of the report."""
    segmentation, alignment, findings = parts.segmentation, parts.alignment, parts.findings
    rigid, scaled = parts.rigid, parts.scaled
    seen, limits = segmentation.seen, options.tolerances_um
    return RegistrationReport(
        transform_scan_to_part=alignment.rigid.matrix,
        scaled_scan_to_part=alignment.scaled.matrix,
        scale=alignment.scaled.scale,
        size_mm=parts.size_mm,
        depth_from_index=scan.modality == "oct" and not scan.depth_standard,
        depth_scale_fitted=alignment.depth_fitted,
        offset_um=1e3 * alignment.scaled.offset_mm * (1 if parts.is_lumen else -1),
        margin=alignment.margin,
        ambiguous=alignment.ambiguous,
        doubts=alignment.doubts,
        lay=alignment.lay,
        depth_axis=alignment.depth_axis,
        rivals=alignment.rivals,
        uncertainty=alignment.uncertainty,
        cross_check_um=parts.cross_um,
        rigid=summarise(rigid.there_mm, limits),
        scaled=summarise(scaled.there_mm, limits),
        rigid_back=summarise(rigid.back_mm, limits),
        scaled_back=summarise(scaled.back_mm, limits),
        rms_interval_um=1e3 * parts.errors.surface_expanded(segmentation.contrast),
        hausdorff_p95_um=rigid.hausdorff_um,
        scaled_hausdorff_p95_um=scaled.hausdorff_um,
        model_seen_fraction=len(scaled.back_mm) / parts.spread,
        surface=replace(
            segmentation.surface, vertices=alignment.rigid.apply(segmentation.surface.vertices)
        ),
        deviation_um=stated_um(rigid.all_mm, seen, parts.errors),
        scaled_deviation_um=stated_um(scaled.all_mm, seen, parts.errors),
        seen=seen,
        histogram_edges_um=HISTOGRAM_EDGES_UM,
        histogram_counts=histogram(scaled.there_mm),
        histogram_counts_rigid=histogram(rigid.there_mm),
        curve_um=CURVE_UM,
        curve_rigid=within_curve(rigid.there_mm),
        curve_scaled=within_curve(scaled.there_mm),
        places=parts.places,
        frame=parts.frame,
        characteristics=parts.characteristics,
        vessels=findings.vessels,
        all_open=all(vessel.open is True for vessel in findings.vessels),
        defects=findings.defects,
        topology=findings.topology,
        agreement=parts.agreement,
        as_printed=parts.printed,
        overlap_rigid=findings.overlap_rigid,
        overlap_scaled=findings.overlap_scaled,
        perfusion=findings.perfusion,
        contrast=findings.contrast,
        needed_voxel_um=needed_voxel_um(
            min(float(np.min(vessel.designed_um)) for vessel in findings.vessels),
            segmentation.field.blur_mm,
            scan.geometric_voxel_mm,
        ),
        gel_at=parts.gel_at,
        walls=scan.walls,
        notes=(
            *scan.notes,
            *pose_notes(scan, alignment),
            *sight_notes(findings.vessels, float(seen.mean())),
            *contrast_notes(findings.contrast),
            *([] if scan.walls else step_notes(segmentation.strength)),
            *uneven_notes(segmentation.field),
            *wall_notes(scan.walls, findings.vessels),
        ),
    )


def stated_um(deviation_mm: FloatArray, seen: NDArray[np.bool_], errors: ScanErrors) -> FloatArray:
    """Return deviations (n,), µm, NaN where not seen; all NaN where walls' errors aren't known."""
    known = seen & np.isfinite(errors.outer_mm)
    return np.where(known, 1e3 * deviation_mm, np.nan)
