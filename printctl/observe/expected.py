"""Compute the ink that a held print should have laid so far, from its job's G-code lines.

On a real machine nothing else is known, and the link proves that these lines were executed. Lines
put into the job (mends) are lines of the job like all others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.machine.job.job import Job
from printctl.observe.mending import HeldPrint, WrittenPath, written_paths
from printctl.observe.mending.held_print import Style


@dataclass(frozen=True)
class ExpectedInk:
    """Straight pieces of written ink, in the order of writing, printer's frame.

    Attributes
    ----------
    paths : tuple of WrittenPath
    start, end : (n, 3) float64, mm
        Of the tip.
    width_mm : (n,) float64, mm
        Of a line in a layer, or diameter of a filament, as the job asks for it: without the
        correction of the flow.
    height_mm : (n,) float64, mm
        Thickness of the layer, or the diameter again.
    area_mm2 : (n,) float64, mm²
        Cross-section.
    command : (n,) int64
        Command of the job, from 0.
    stroke : (n,) int64
        Number of the path.
    time_s : (n,) float64, s
        Of its middle, by the speeds that the job asks for, writing alone.
    factor : (n,) float64
        Ink that the grown job pushes there over what its file says.
    style : "layered" or "embedded"
    inserted : (n,) bool
        Of lines that were put into the job.
    """

    paths: tuple[WrittenPath, ...]
    start: FloatArray
    end: FloatArray
    width_mm: FloatArray
    height_mm: FloatArray
    area_mm2: FloatArray
    command: IntArray
    stroke: IntArray
    time_s: FloatArray
    factor: FloatArray
    style: Style
    inserted: BoolArray

    def __len__(self) -> int:
        return len(self.command)

    def between(self, first: int, last: int) -> BoolArray:
        """Which pieces the commands ``first`` up to, not including, ``last`` write, (n,)."""
        return (self.command >= first) & (self.command < last)


def expected_ink(held: HeldPrint, job: Job) -> ExpectedInk:
    """Return all ink of a job up to the place where it is held.

    Parameters
    ----------
    held : HeldPrint
    job : Job
        The same job with its inserts, which tell where the flow was corrected.
    """
    paths = written_paths(held)
    if not paths:
        none = np.zeros(0)
        return _of_pieces((), none, none, none, none, held, none.astype(np.bool_))
    command = np.concatenate([one.command for one in paths])
    factor, inserted = flow_factors(job)[command], _inserted(job)[command]
    area = np.concatenate([one.e_per_mm for one in paths]) * held.ul_per_e / factor
    feed = np.concatenate([one.feed_mm_s for one in paths])
    height = np.concatenate([one.height_mm for one in paths])
    return _of_pieces(paths, area, feed, height, factor, held, inserted)


def _inserted(job: Job) -> BoolArray:
    """Which lines of a grown job were put in, (n,)."""
    inserted = np.zeros(len(job), dtype=np.bool_)
    for after, count in job.positions:
        inserted[after : after + count] = True
    return inserted


def _of_pieces(
    paths: tuple[WrittenPath, ...],
    area: FloatArray,
    feed: FloatArray,
    height: FloatArray,
    factor: FloatArray,
    held: HeldPrint,
    inserted: BoolArray,
) -> ExpectedInk:
    none = np.zeros((0, 3))
    start = np.vstack([none, *(one.points[:-1] for one in paths)])
    end = np.vstack([none, *(one.points[1:] for one in paths)])
    command = np.concatenate([np.zeros(0, np.int64), *(one.command for one in paths)])
    count = [len(one.command) for one in paths]
    seconds = np.linalg.norm(end - start, axis=1) / np.maximum(feed, 1e-9)
    if held.style == "layered":
        width = held.ink.bead_section.width(area, height) if len(area) else area
    else:
        width = height = np.sqrt(4 / np.pi * area) * (held.ink.swell_factor or 1.0)
    return ExpectedInk(
        paths,
        start,
        end,
        width,
        height,
        area,
        command,
        np.repeat(np.arange(len(paths)), count),
        np.cumsum(seconds) - seconds / 2,
        factor,
        held.style,
        inserted,
    )


def flow_factors(job: Job) -> FloatArray:
    """Ink that each line of a grown job pushes over what the file says, (n,); 1 in inserts."""
    factor = np.ones(len(job))
    for one in job.inserts:
        factor[one.after + len(one.lines) :] = one.flow
    for after, count in job.positions:
        factor[after : after + count] = 1.0
    return factor
