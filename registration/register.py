"""Register a scan to its design: segment, fit the pose, measure deviations, vessels and defects."""

from __future__ import annotations

from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace

import numpy as np

from design.geometry.surface import Surface
from design.network import VesselNetwork
from design.solids.solid import Solid
from kernels import helper_thread
from kernels.arrays import FloatArray
from registration.alignment import Alignment, Fit, align, cross_check, later_doubts
from registration.assemble import FitDeviations, RegistrationParts, assemble
from registration.findings import Findings, Inspection, inspect
from registration.measuring.gauging import ScannedSurface, deviations, surface_points
from registration.measuring.gauging.face_places import LEAST_UM, FacePlace, ScannedFaces
from registration.measuring.gauging.near_lumen import near_lumen
from registration.measuring.geometry import (
    Characteristic,
    Face,
    Frame,
    Scene,
    characteristics,
    cuts_of,
    outer_faces,
)
from registration.measuring.geometry.faces import POINTS, RIM_BLURS, RIM_MM
from registration.measuring.topology import agreement
from registration.options import RegistrationOptions
from registration.part_frame import Ground, find_frame
from registration.prepared import PreparedScan
from registration.result import RegistrationReport
from registration.scan import Scan
from registration.segmentation import GelEvidence, gel_evidence
from registration.segmentation.evidence import are_separable


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
    case = PreparedScan.of(scan, model, network, options or RegistrationOptions())
    with helper_thread() as other:
        parts = _registered(case, other)
    return assemble(parts, scan, case.options)


def _registered(case: PreparedScan, other: Executor) -> RegistrationParts:
    """Align, measure and inspect; `other` does beside it what doesn't wait for this."""
    segmentation = case.segmentation
    evidence = other.submit(
        gel_evidence, segmentation.field, segmentation.strength, case.scan.depth_down
    )
    lying = _laid(case)
    measured = _measured(case, lying.alignment, other)
    findings = _inspected(case, lying.alignment, measured.scaled, evidence.result())
    return RegistrationParts(
        segmentation,
        _doubted(case, lying.alignment, measured.cross_um.result()),
        case.is_lumen,
        measured.cross_um.result(),
        measured.spread,
        measured.places.result(),
        measured.rigid.result(),
        measured.scaled,
        findings,
        lying.frame,
        _characterised(case, lying, findings),
        case.errors,
        _gel_at(case, lying.alignment.scaled, evidence.result()),
        agreement(case.surface, case.network, segmentation, lying.alignment.scaled, case.is_lumen),
    )


def _gel_at(case: PreparedScan, fit: Fit, evidence: GelEvidence) -> FloatArray | None:
    """Whether there is gel at the places that the options name; NaN where it can't be told."""
    if case.options.places_mm is None:
        return None
    places = fit.invert(case.options.places_mm)
    value = case.segmentation.field.above_level(places)
    told = np.isfinite(value) & are_separable(1.0, 0.0, evidence.scatter_at(places))
    return np.where(told, value >= 0, np.nan)


@dataclass(frozen=True)
class _Lying:
    """How the part lies: its pose, its outer faces where it has any, and the report's frame."""

    alignment: Alignment
    faces: tuple[Face, ...]
    frame: Frame


def _laid(case: PreparedScan) -> _Lying:
    """Find the pose, and lay the part's frame on the print."""
    alignment = _aligned(case)
    faces = () if case.is_lumen else _faces(case, alignment)
    part = None if case.is_lumen else case.surface
    ground = Ground(case.network, case.segmentation, faces, case.errors, case.section_mm, part)
    frame = find_frame(case.options.datums, alignment, ground)
    return _Lying(replace(alignment, rigid=frame.fit), faces, frame)


def _aligned(case: PreparedScan) -> Alignment:
    segmentation, scan = case.segmentation, case.scan
    return align(
        case.surface,
        segmentation.surface.vertices[segmentation.seen],
        scan.depth_down,
        case.options.alignment,
        blur_mm=segmentation.field.blur_mm,
        depth_standard=scan.depth_standard,
        errors=case.errors,
        lumens=case.is_lumen,
        lit=float(segmentation.seen.mean()),
    )


def _faces(case: PreparedScan, alignment: Alignment) -> tuple[Face, ...]:
    return outer_faces(case.surface, case.network, case.segmentation, alignment.scaled)


@dataclass(frozen=True)
class _Measured:
    """Deviations by both fits, and what another program makes of the pose.

    Attributes
    ----------
    rigid : Future of FitDeviations
    scaled : FitDeviations
    cross_um : Future of float or None, µm
    spread : int
        Points on the design from which the scanned surface was looked for.
    places : Future of tuple of FacePlace
        Where the surface away from lumens stands out.
    """

    rigid: Future[FitDeviations]
    scaled: FitDeviations
    cross_um: Future[float | None]
    spread: int
    places: Future[tuple[FacePlace, ...]]


def _measured(case: PreparedScan, alignment: Alignment, other: Executor) -> _Measured:
    surface, segmentation = case.surface, case.segmentation
    spread, scanned = surface_points(surface), ScannedSurface.of(segmentation)
    points = segmentation.surface.vertices[segmentation.seen]
    rigid = other.submit(_both_ways, case, scanned, alignment.rigid, spread)
    cross_um = other.submit(cross_check, surface, spread, points, alignment.scaled)
    scaled = _both_ways(case, scanned, alignment.scaled, spread)
    places = other.submit(_places, case, alignment.scaled, scaled)
    return _Measured(rigid, scaled, cross_um, len(spread), places)


def _places(case: PreparedScan, fit: Fit, deviation: FitDeviations) -> tuple[FacePlace, ...]:
    """Where outer faces stand out; none where only lumens were scanned or errors aren't known."""
    segmentation, blur_mm = case.segmentation, case.segmentation.field.blur_mm
    if case.is_lumen or not np.isfinite(case.errors.outer_mm):
        return ()
    vertices, off_um = fit.apply(segmentation.surface.vertices), 1e3 * deviation.all_mm
    drawn = np.flatnonzero(segmentation.seen)
    drawn = drawn[:: max(1, len(drawn) // POINTS)]
    usual = off_um[drawn[~near_lumen(vertices[drawn], case.network)]]
    if not len(usual):
        return ()
    spread = 1.4826 * float(np.median(np.abs(usual - np.median(usual))))
    # Few places are off: only of these is it asked what they lie near.
    off = np.flatnonzero(segmentation.seen & (np.abs(off_um) > LEAST_UM))
    off = off[~near_lumen(vertices[off], case.network)]
    counted, rims = np.full(len(vertices), np.nan), np.zeros(len(vertices), dtype=np.bool_)
    counted[off] = off_um[off]
    rims[off] = case.surface.near_rims(vertices[off], max(RIM_BLURS * blur_mm, RIM_MM))
    return ScannedFaces(
        Surface(vertices, segmentation.surface.faces), counted, rims, 1e3 * blur_mm, spread
    ).places_off()


def _both_ways(
    case: PreparedScan, scanned: ScannedSurface, fit: Fit, spread: FloatArray
) -> FitDeviations:
    segmentation = case.segmentation
    there = deviations(case.surface, fit.apply(segmentation.surface.vertices), case.is_lumen)
    return FitDeviations(there, there[segmentation.seen], scanned.deviations_back(spread, fit))


def _inspected(
    case: PreparedScan, alignment: Alignment, scaled: FitDeviations, evidence: GelEvidence
) -> Findings:
    return inspect(
        Inspection(
            case.network,
            case.surface,
            case.is_lumen,
            case.segmentation,
            alignment,
            scaled.all_mm,
            case.section_mm,
            case.options.false_alarm,
            case.options.flow,
            case.errors,
            evidence,
        )
    )


def _doubted(case: PreparedScan, alignment: Alignment, cross_um: float | None) -> Alignment:
    """Add the doubts that come up only behind the alignment."""
    later = later_doubts(cross_um, float(case.segmentation.seen.mean()))
    return replace(alignment, doubts=(*alignment.doubts, *later))


def _characterised(
    case: PreparedScan, lying: _Lying, findings: Findings
) -> tuple[Characteristic, ...]:
    """Form and place of faces and vessels in the frame."""
    scene = Scene(case.network, lying.faces, cuts_of(findings.vessels), case.errors)
    gauged = tuple(vessel.gauged_fraction for vessel in findings.vessels)
    return characteristics(scene, gauged, case.surface, lying.frame)
