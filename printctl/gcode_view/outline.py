"""The design's outline over a layer of a G-code file."""

from __future__ import annotations

import numpy as np

from design.solids import Solid
from design.solids.manifolds import solid_manifold
from printctl.lumens import WrittenLines, find_place
from registration.report.gcode import DesignOutline, GcodeJob, design_outline

FloatArray = np.typing.NDArray[np.float64]


def part_outline(
    job: GcodeJob, layer: int, part: Solid, place_mm: FloatArray | None
) -> DesignOutline:
    """Section of a part at the middle of a layer, held against the layer's lines.

    Parameters
    ----------
    job : GcodeJob
        In layers.
    layer : int
        From 0.
    part : Solid
        With its lumens open.
    place_mm : (3,) float64, mm, optional
        The part's origin in the printer's frame; found from what is written where it isn't given.

    Raises
    ------
    UsageError
        When the place isn't given and can't be found.
    """
    place = find_place(_lines(job), part) if place_mm is None else place_mm
    z = job.layers.z_mm[layer] - 0.5 * job.layers.height_mm[layer] - place[2]
    rings = solid_manifold(part, "the part").slice(float(z)).to_polygons()
    return design_outline(job, layer, [np.asarray(ring) + place[:2] for ring in rings])


def _lines(job: GcodeJob) -> WrittenLines:
    """What is written, as `find_place` takes it."""
    rows = np.flatnonzero(job.writes)
    width = np.nan_to_num(job.width_mm[rows])
    high = job.layers.z_mm
    return WrittenLines(
        start=job.start[rows, :2],
        end=job.end[rows, :2],
        width=width,
        mean=width,
        layer=job.layer[rows],
        low=high - job.layers.height_mm,
        high=high,
        line=job.line[rows],
    )
