"""Find the part's reference frame in a scan: best fit, or laid on chosen datums."""

from __future__ import annotations

from dataclasses import dataclass

from design.network import VesselNetwork
from registration.alignment import Alignment
from registration.alignment.distance import ModelSurface
from registration.alignment.uncertainty import ScanErrors
from registration.measuring.gauging import VesselTrace, trace_vessels
from registration.measuring.gauging.outlines import outlines
from registration.measuring.geometry import Cut, Datum, Face, Frame, Scene, best_fit, lay_on_datums
from registration.segmentation import Segmentation


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
