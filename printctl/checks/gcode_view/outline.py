"""Cut the designed part at each layer of a G-code job, to draw its outline over the lines."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from design.solids import Solid
from design.solids.manifolds import solid_manifold
from kernels.arrays import FloatArray
from printctl.checks.lumens import WrittenLines, find_place
from report.gcode import DesignOutline, GcodeJob, design_outline

Design = tuple[Solid, FloatArray]
"""The part as it is to be written, and where its origin stands in the printer's frame."""


class PartOutlines:
    """Sections of a part at the middle of a job's layers, held against the layers' lines.

    Parameters
    ----------
    job : GcodeJob
        In layers.
    part : Solid
        With its lumens open.
    place_mm : (3,) float64, mm, optional
        The part's origin in the printer's frame; found from what is written where it isn't given.

    Raises
    ------
    UsageError
        When the place isn't given and can't be found.
    """

    def __init__(self, job: GcodeJob, part: Solid, place_mm: FloatArray | None) -> None:
        self._job = job
        self._place = find_place(_lines(job), part) if place_mm is None else place_mm
        self._body = solid_manifold(part, "the part")

    def at(self, layer: int) -> DesignOutline:
        """The outline in a layer, counted from 0."""
        levels, place = self._job.layers, self._place
        z = levels.z_mm[layer] - 0.5 * levels.height_mm[layer] - place[2]
        rings = self._body.slice(float(z)).to_polygons()
        return design_outline(self._job, layer, [np.asarray(ring) + place[:2] for ring in rings])

    def __iter__(self) -> Iterator[DesignOutline]:
        return (self.at(layer) for layer in range(len(self._job.layers)))


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
