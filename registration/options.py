"""Options of a registration, and segmentation options derived from them, scan and design."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from design.hemodynamics import FlowConditions
from kernels.arrays import FloatArray
from registration.alignment import AlignmentOptions
from registration.measuring.gauging import TOLERANCES_UM
from registration.measuring.gauging.changes import FALSE_ALARM
from registration.measuring.geometry.datum import Datum
from registration.scan import Scan
from registration.segmentation import SegmentationOptions
from registration.segmentation.working import bins

MOST_WORKING_VOXELS = 20_000_000
"""What a segmentation works on, unless 0.1 mm asks for more: with 1 GB in all."""


@dataclass(frozen=True)
class RegistrationOptions:
    """Options of a registration.

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
    false_alarm : float
        Probability that a scan without defects shows a bulge or a stenosis.
    flow : FlowConditions or None
        What drives the printed network; None for 1 µL/s of water, which gives the same split.
    alignment : AlignmentOptions
        Of the search.
    datums : tuple of Datum
        On which the part's frame is laid, the primary first; none for the best fit.
    places_mm : (p, 3) float64 or None, mm
        Places of the part, as designed, at which the report is to say whether there is gel.
    """

    working_voxel_mm: float | None = None
    smoothing_mm: float | None = None
    lumens: Literal["dark", "bright"] = "dark"
    section_mm: float | None = None
    tolerances_um: tuple[float, ...] = TOLERANCES_UM
    false_alarm: float = FALSE_ALARM
    flow: FlowConditions | None = None
    alignment: AlignmentOptions = field(default_factory=AlignmentOptions)
    datums: tuple[Datum, ...] = ()
    places_mm: FloatArray | None = field(default=None, compare=False)


def segmentation_options(
    scan: Scan, options: RegistrationOptions, thinnest: float
) -> SegmentationOptions:
    """How a scan is segmented for a design whose thinnest lumen is so wide, mm."""
    fine = thinnest / 8
    if scan.modality == "oct":
        # Whole voxels are averaged, so that what is rounded down may still be too many.
        fine = thinnest / 12
        while fine < 0.1 and scan.volume.size > MOST_WORKING_VOXELS * np.prod(bins(scan, fine)):
            fine *= 1.02
    return SegmentationOptions(
        working_voxel_mm=options.working_voxel_mm or min(0.1, fine),
        smoothing_mm=options.smoothing_mm,
        lumens=options.lumens,
        wall_mm=0.0 if scan.walls is None else 1e-3 * scan.walls.offset_um,
    )
