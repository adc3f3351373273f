"""Register a scan to its design: segment, fit the pose, measure deviations and vessels."""

from __future__ import annotations

from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace

import numpy as np

from design.geometry.surface import Surface
from design.network import VesselNetwork
from design.solids.solid import Solid
from kernels import helper_thread
from kernels.arrays import FloatArray
from registration.alignment import (
    Alignment,
    Fit,
    align,
    cross_check,
    later_doubts,
    rival_doubts,
)
from registration.alignment.as_printed import AsPrinted, Explanation, Misfit
from registration.alignment.distance import ModelSurface
from registration.alignment.symmetry import moved_vessels
from registration.assemble import FitDeviations, RegistrationParts, assemble
from registration.errors import AlignmentError
from registration.findings import Findings, Inspection, inspect
from registration.measuring.gauging import (
    ScannedSurface,
    VesselTrace,
    deviations,
    surface_points,
    trace_vessels,
)
from registration.measuring.gauging.deviation import near_lumen
from registration.measuring.gauging.on_walls import outlines
from registration.measuring.gauging.openings.face_places import LEAST_UM, FacePlace, ScannedFaces
from registration.measuring.geometry import (
    Characteristic,
    Cut,
    Face,
    Frame,
    Scene,
    best_fit,
    characteristics,
    cuts_of,
    lay_on_datums,
    outer_faces,
)
from registration.measuring.geometry.faces import POINTS, RIM_BLURS, RIM_MM
from registration.measuring.topology import Landed, agreement
from registration.options import RegistrationOptions
from registration.prepared import PreparedScan
from registration.result import RegistrationReport
from registration.scan import Scan
from registration.segmentation import GelEvidence, gel_evidence
from registration.segmentation.gel_probe import GelProbe


def find_frame(case: PreparedScan, alignment: Alignment, faces: tuple[Face, ...]) -> Frame:
    """Return the frame of the best fit, or of datums.

    Raises
    ------
    DatumError
        When datums aren't there, aren't seen, or leave the part free to move.
    """
    datums = case.options.datums
    if not datums:
        return best_fit(alignment.rigid, alignment.uncertainty, case.errors)
    cuts: tuple[Cut, ...] = ()
    if any(datum.kind != "face" for datum in datums):
        part = None if case.is_lumen else case.surface
        traces = trace_vessels(
            case.network, case.segmentation, alignment.scaled, case.section_mm, part
        )
        cuts = tuple(map(_cut, traces))
    scene = Scene(case.network, faces, cuts, case.errors)
    return lay_on_datums(datums, alignment.rigid, scene)


def _cut(trace: VesselTrace) -> Cut:
    counted = trace.counted
    return Cut(
        trace.along[counted],
        outlines(trace.planes, trace.sections, trace.diameter, counted),
        trace.sections.noise[counted],
    )


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
    measured = _measured(case, lying, other)
    findings = _inspected(case, lying.alignment, measured.scaled, evidence.result())
    return RegistrationParts(
        segmentation,
        _doubted(case, lying.alignment, measured.cross_um.result()),
        np.ptp(case.surface.bounds, axis=0),
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
        agreement(
            Landed(
                case.surface,
                case.network,
                segmentation,
                evidence.result(),
                lying.alignment.scaled,
                case.is_lumen,
                case.scan.depth_down,
                lying.printed.is_known,
            )
        ),
        lying.printed,
    )


def _gel_at(case: PreparedScan, fit: Fit, evidence: GelEvidence) -> FloatArray | None:
    """Whether there is gel at the places that the options name; NaN where it can't be told."""
    if case.options.places_mm is None:
        return None
    probe = GelProbe(case.segmentation, case.scan.depth_down, evidence, calibrated=False)
    read = probe.at(fit.invert(case.options.places_mm))
    return np.where(read.known, read.gel, np.nan)


@dataclass(frozen=True)
class _Lying:
    """How the part lies: its pose, its outer faces where it has any, and the report's frame.

    `surface` is what it was aligned to: the design as it was `printed`.
    """

    alignment: Alignment
    surface: ModelSurface
    printed: AsPrinted
    faces: tuple[Face, ...]
    frame: Frame


def _laid(case: PreparedScan) -> _Lying:
    """Find the pose, and lay the part's frame on the print."""
    found = _aligned_as_printed(case)
    alignment = found.alignment
    faces = (
        ()
        if case.is_lumen
        else outer_faces(case.surface, case.network, case.segmentation, alignment.scaled)
    )
    frame = find_frame(case, alignment, faces)
    return _Lying(replace(alignment, rigid=frame.fit), found.surface, found.printed, faces, frame)


def _aligned_as_printed(case: PreparedScan) -> Explanation:
    """Find the pose; where much doesn't fit, of the design as far as it was printed."""
    segmentation = case.segmentation
    misfit = Misfit(
        case.model,
        case.surface,
        segmentation.surface.vertices[segmentation.seen],
        segmentation.field,
        case.is_lumen,
        lambda surface: align_prepared(replace(case, surface=surface)),
        case.options.alignment,
    )
    try:
        plain = align_prepared(case)
    except AlignmentError:
        explained = misfit.explained(None)
        if explained is None:
            raise
        return explained
    return misfit.explained(plain) or Explanation(plain, case.surface, AsPrinted())


def align_prepared(case: PreparedScan) -> Alignment:
    """Find the pose of a segmented scan."""
    segmentation, scan = case.segmentation, case.scan
    alignment = align(
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
    rivals = [
        replace(one, vessels=moved_vessels(case.network, one.matrix)) if one.same else one
        for one in alignment.rivals
    ]
    return replace(alignment, rivals=tuple(rivals))


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


def _measured(case: PreparedScan, lying: _Lying, other: Executor) -> _Measured:
    alignment = lying.alignment
    surface, segmentation = case.surface, case.segmentation
    spread, scanned = surface_points(surface), ScannedSurface.of(segmentation)
    points = segmentation.surface.vertices[segmentation.seen]
    rigid = other.submit(_both_ways, case, scanned, alignment.rigid, spread)
    drawn = spread if lying.surface is surface else surface_points(lying.surface)
    cross_um = other.submit(cross_check, lying.surface, drawn, points, alignment.scaled)
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
    off_mm = scaled.all_mm
    return inspect(
        Inspection(**vars(case), alignment=alignment, deviation_mm=off_mm, evidence=evidence)
    )


def _doubted(case: PreparedScan, alignment: Alignment, cross_um: float | None) -> Alignment:
    """Add the doubts that come up only behind the alignment."""
    later = later_doubts(cross_um, float(case.segmentation.seen.mean()))
    limit = case.options.alignment.ambiguous_below
    # A symmetry of the design is no obstacle of its own: what else there is comes first.
    same = rival_doubts((rival for rival in alignment.rivals if rival.same), limit)
    doubts = sorted((*alignment.doubts, *later), key=lambda doubt: doubt in same)
    return replace(alignment, doubts=tuple(doubts))


def _characterised(
    case: PreparedScan, lying: _Lying, findings: Findings
) -> tuple[Characteristic, ...]:
    """Form and place of faces and vessels in the frame."""
    scene = Scene(case.network, lying.faces, cuts_of(findings.vessels), case.errors)
    gauged = tuple(vessel.gauged_fraction for vessel in findings.vessels)
    return characteristics(scene, gauged, case.surface, lying.frame)
