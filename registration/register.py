"""Scan to report: segment, align, gauge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from design.network import VesselNetwork
from design.solids.solid import Solid
from kernels import beside
from registration.alignment import Fit, align, cross_check, later_doubts
from registration.assemble import BothWays, Registered, assemble
from registration.distance import ModelSurface
from registration.errors import RegistrationError
from registration.findings import Inspection, inspect
from registration.gauging import ScannedSurface, deviations, surface_points
from registration.geometry import Scene, characteristics, cuts_of, outer_faces
from registration.laying import Ground, laid
from registration.options import RegistrationOptions, segmentation_options
from registration.result import RegistrationReport
from registration.scan import Scan
from registration.segmentation import gel_evidence, segment
from registration.uncertainty import scan_errors

FloatArray = NDArray[np.float64]


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
    thinnest = 2 * float(network.radius.min())
    segmentation = segment(scan, segmentation_options(scan, options, thinnest))
    errors = scan_errors(scan, segmentation, options.walls)
    surface = ModelSurface.of(model)
    is_lumen = _model_is_lumen(surface, network)
    points = segmentation.vertices[segmentation.seen]
    with beside() as other:
        # What needs no pose is computed while one is searched for, and so on below.
        evidence = other.submit(
            gel_evidence, segmentation.field, segmentation.strength, scan.depth_down
        )
        alignment = align(
            surface,
            points,
            scan.depth_down,
            options.alignment,
            blur_mm=segmentation.field.blur_mm,
            depth_standard=scan.depth_standard,
            errors=errors,
        )
        section_mm = options.section_mm or thinnest / 4
        faces = () if is_lumen else outer_faces(surface, network, segmentation, alignment.scaled)
        frame = laid(
            options.datums, alignment, Ground(network, segmentation, faces, errors, section_mm)
        )
        alignment = replace(alignment, rigid=frame.fit)
        spread = surface_points(surface)
        scanned = ScannedSurface.of(segmentation)
        rigid = other.submit(_both_ways, surface, scanned, alignment.rigid, spread, is_lumen)
        cross_um = other.submit(cross_check, surface, spread, points, alignment.scaled)
        scaled = _both_ways(surface, scanned, alignment.scaled, spread, is_lumen)
        findings = inspect(
            Inspection(
                network,
                surface,
                is_lumen,
                segmentation,
                alignment,
                scaled.all_mm,
                section_mm,
                options.false_alarm,
                options.flow,
                errors,
                evidence.result(),
            )
        )
        zones = characteristics(
            Scene(network, faces, cuts_of(findings.vessels), errors),
            tuple(vessel.gauged_fraction for vessel in findings.vessels),
            surface,
            frame,
        )
    later = later_doubts(cross_um.result(), float(segmentation.seen.mean()))
    found = Registered(
        segmentation,
        replace(alignment, doubts=(*alignment.doubts, *later)),
        is_lumen,
        cross_um.result(),
        len(spread),
        rigid.result(),
        scaled,
        findings,
        frame,
        zones,
    )
    return assemble(found, scan, options)


def _both_ways(
    surface: ModelSurface, scanned: ScannedSurface, fit: Fit, spread: FloatArray, is_lumen: bool
) -> BothWays:
    segmentation = scanned.segmentation
    there = deviations(surface, fit.apply(segmentation.vertices), is_lumen)
    return BothWays(there, there[segmentation.seen], scanned.deviations_back(spread, fit))


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
