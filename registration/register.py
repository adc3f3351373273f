"""Register a scan to its design: segment, fit the pose, measure deviations and vessels."""

from __future__ import annotations

from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from design.geometry.surface import Surface
from design.network import VesselNetwork
from design.solids.solid import Solid
from kernels import helper_thread, keep_freed_memory
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
from registration.alignment.uncertainty import ScanErrors, scan_errors
from registration.assemble import FitDeviations, RegistrationParts, assemble
from registration.errors import AlignmentError, RegistrationError
from registration.findings import Findings, Inspection, inspect
from registration.measuring.gauging import (
    ScannedSurface,
    VesselTrace,
    deviations,
    surface_points,
    trace_vessels,
)
from registration.measuring.gauging.deviation import near_lumen
from registration.measuring.gauging.openings.face_places import LEAST_UM, FacePlace, ScannedFaces
from registration.measuring.gauging.vessels import outlines
from registration.measuring.geometry import (
    Characteristic,
    Cut,
    Datum,
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
from registration.options import RegistrationOptions, segmentation_options
from registration.result import RegistrationReport
from registration.scan import Scan
from registration.segmentation import GelEvidence, Segmentation, gel_evidence, segment
from registration.segmentation.gel_probe import GelProbe

# Segment a scan and prepare the model's surface for alignment; check that they match.

LARGEST_FIELD = 20.0
"""Of the part's longest edge: a field of view larger than that each way shows something else."""


@dataclass(frozen=True)
class PreparedScan:
    """What every step behind the segmentation takes; build with `of`.

    Attributes
    ----------
    scan : Scan
    model : Solid
    network : VesselNetwork
    options : RegistrationOptions
    segmentation : Segmentation
        Of the scan.
    surface : ModelSurface
        Of the model.
    is_lumen : bool
        The model is the lumens, not the gel around them.
    errors : ScanErrors
        What all measurements of the scan share.
    section_mm : float, mm
        Between sections along a vessel.
    """

    scan: Scan
    model: Solid
    network: VesselNetwork
    options: RegistrationOptions
    segmentation: Segmentation
    surface: ModelSurface
    is_lumen: bool
    errors: ScanErrors
    section_mm: float

    @staticmethod
    def of(
        scan: Scan, model: Solid, network: VesselNetwork, options: RegistrationOptions
    ) -> PreparedScan:
        """Segment the scan, and see what the model is.

        Raises
        ------
        RegistrationError
            When the scan can't be segmented, or scan, model and network don't belong together.
        """
        thinnest = 2 * float(network.radius.min())
        _check_sizes(scan, model, thinnest)
        # The surface takes one core, and the segmentation leaves one free now and then.
        with ThreadPoolExecutor(1) as other, keep_freed_memory():
            preparing = other.submit(ModelSurface.of, model)
            # An OCT needn't know what the model is: its surface is prepared meanwhile.
            whole = scan.modality != "oct" and not _model_is_lumen(preparing.result(), network)
            how = replace(segmentation_options(scan, options, thinnest), whole_part=whole)
            segmentation = segment(scan, how)
        errors = scan_errors(scan, segmentation)
        surface = preparing.result()
        is_lumen = _model_is_lumen(surface, network)
        section_mm = options.section_mm or thinnest / 4
        return PreparedScan(
            scan, model, network, options, segmentation, surface, is_lumen, errors, section_mm
        )


def _check_sizes(scan: Scan, model: Solid, thinnest_mm: float) -> None:
    """Refuse a scan in which no lumen has room, or the part is lost: a wrong unit."""
    if scan.volume.ndim != 3:
        return  # no stack: the segmentation says so
    extent = np.array(scan.volume.shape)[::-1] * np.array(scan.geometric_voxel_mm)[::-1]
    part = np.ptp(model.vertices, axis=0)
    if thinnest_mm <= extent.max() and extent.min() <= LARGEST_FIELD * part.max():
        return
    raise RegistrationError(
        f"the scan is {_sizes(extent)} mm and the model {_sizes(part)} mm, with lumens from "
        f"{thinnest_mm:.3g} mm: they don't fit each other; check the voxel size (--voxel-um, "
        "or scan.voxel_um in a recipe; µm) and the units of model and network"
    )


def _sizes(size: FloatArray) -> str:
    return " × ".join(f"{one:.3g}" for one in size)


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


# Find the part's reference frame in a scan: best fit, or laid on chosen datums.


@dataclass(frozen=True)
class Ground:
    """What a frame is laid on.

    Attributes
    ----------
    network : VesselNetwork
    segmentation : Segmentation
    faces : tuple of Face
    errors : ScanErrors
    section_mm : float, mm
        Between sections.
    part : ModelSurface or None
        The designed part; None where the model is the lumens alone.
    """

    network: VesselNetwork
    segmentation: Segmentation
    faces: tuple[Face, ...]
    errors: ScanErrors
    section_mm: float
    part: ModelSurface | None


def find_frame(datums: tuple[Datum, ...], alignment: Alignment, ground: Ground) -> Frame:
    """Return the frame of the best fit, or of datums.

    Raises
    ------
    DatumError
        When datums aren't there, aren't seen, or leave the part free to move.
    """
    if not datums:
        return best_fit(alignment.rigid, alignment.uncertainty, ground.errors)
    cuts: tuple[Cut, ...] = ()
    if any(datum.kind != "face" for datum in datums):
        traces = trace_vessels(
            ground.network,
            ground.segmentation,
            alignment.scaled,
            ground.section_mm,
            ground.part,
        )
        cuts = tuple(map(_cut, traces))
    scene = Scene(ground.network, ground.faces, cuts, ground.errors)
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
    probe = GelProbe(case.segmentation, case.scan.depth_down, evidence)
    return probe.at(fit.invert(case.options.places_mm)).share


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
    part = None if case.is_lumen else case.surface
    ground = Ground(case.network, case.segmentation, faces, case.errors, case.section_mm, part)
    frame = find_frame(case.options.datums, alignment, ground)
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
