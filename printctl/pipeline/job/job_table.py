"""Build a job's per-line progress table (time, ink, tip, layer, vessel) from its dry run."""

from __future__ import annotations

import numpy as np

from gcode.dry_run.run import DryRun
from kernels.arrays import FloatArray, IntArray
from printctl.machine.job.job import Job
from printctl.machine.prints.progress import NONE, JobTable
from report.gcode import Act, GcodeJob


def make_table(job: Job, run: DryRun, volume_ul: FloatArray, view: GcodeJob | None) -> JobTable:
    """Make the table of a job.

    Parameters
    ----------
    job : Job
        As the link counts its commands.
    run : DryRun
    volume_ul : (rows,) float64, µL
        What each row of the run's program writes (`printctl.checks.preflight.volumes`).
    view : GcodeJob or None
        Layers and vessels; None for a job in which nothing is written.
    """
    line = np.array([0, *job.file_lines], np.int64)
    last = max(int(run.program.line.max(initial=0)), int(line.max()))
    at = np.zeros(last + 1, np.int64)
    np.maximum.at(at, run.program.line, np.arange(1, len(run.program.line) + 1))
    row = np.maximum.accumulate(at)[line]  # of the program, up to each line and that one included
    in_layers = _written(view, None if view is None else view.layer)
    in_vessels = _written(view, None if view is None else view.vessel)
    layer, layers = _parts(*in_layers, line)
    vessel, vessels = _parts(*in_vessels, line)
    return JobTable(
        time_s=_times(run, line, last),
        ink_ul=_ink(run, volume_ul, last)[line],
        plunger_mm=np.concatenate([[0.0], run.program.plunger])[row],
        file_line=line,
        layer=layer,
        vessel=vessel,
        layers_done=_done(*in_layers, line),
        vessels_done=_done(*in_vessels, line),
        tip_mm=np.concatenate([run.program.start[None, :3], run.program.target[:, :3]])[row],
        layer_count=layers,
        vessel_count=vessels,
        passes=view is not None and view.layers.passes,
    )


def _times(run: DryRun, line: IntArray, last: int) -> FloatArray:
    """When the dry run has executed each line, s; its whole time at the end."""
    result, executed = np.zeros(last + 1), run.executed
    if len(executed):
        of_command = np.zeros(int(run.program.command.max()) + 1, np.int64)
        of_command[run.program.command] = run.program.line
        known = executed.line >= 0
        end = executed.time_end[known] - executed.time_start[0]
        np.maximum.at(result, of_command[executed.line[known]], end)
    times = np.minimum(np.maximum.accumulate(result)[line], run.duration_s)
    times[-1] = run.duration_s
    return np.asarray(times)


def _ink(run: DryRun, volume_ul: FloatArray, last: int) -> FloatArray:
    """What has been written after each line, µL: what a plunger takes back comes out again."""
    result = np.zeros(last + 1)
    for tool in np.unique(run.program.tool):
        of = np.where(run.program.tool == tool, volume_ul, 0.0)
        whole = np.cumsum(np.bincount(run.program.line, of, last + 1))
        result += np.maximum.accumulate(np.maximum(whole, 0.0))
    return result


def _written(view: GcodeJob | None, part: IntArray | None) -> tuple[IntArray, IntArray]:
    """Lines that write, and the part that each belongs to."""
    if view is None or part is None:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    writes = (view.act == Act.WRITE) & (part >= 0)
    return view.line[writes], part[writes]


def _parts(at: IntArray, part: IntArray, line: IntArray) -> tuple[IntArray, int]:
    """Part that is written at each line, or next; numbered from 0 in the order of writing."""
    if not len(at):
        return np.full(len(line), NONE, np.int64), 0
    first = np.sort(np.unique(part, return_index=True)[1])
    rank = np.full(int(part.max()) + 1, NONE, np.int64)
    rank[part[first]] = np.arange(len(first))
    here = np.searchsorted(at, line, side="left")
    return rank[part[np.minimum(here, len(part) - 1)]], len(first)


def _done(at: IntArray, part: IntArray, line: IntArray) -> IntArray:
    """How many parts have been written to their end after each line."""
    ends = np.zeros(int(part.max(initial=0)) + 1, np.int64)
    np.maximum.at(ends, part, at)
    return np.searchsorted(np.sort(ends[ends > 0]), line, side="right").astype(np.int64)
