"""Check a job in a process of its own; its tables."""

from __future__ import annotations

import hashlib
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from firmware_profiles import ProfileError
from kernels.arrays import FloatArray, IntArray
from printctl.checks.gcode_view import Pushing, read_job, read_line_map
from printctl.checks.preflight import (
    Check,
    PrintTime,
    SetUp,
    file_checks,
    ink_use,
    viability_checks,
    viability_facts,
    volumes,
)
from printctl.checks.preflight.shaft import file_shaft
from printctl.errors import PrintctlError, UsageError
from printctl.failures import message_and_code
from printctl.machine.link.job import Job, parse_job
from printctl.machine.printing import with_reloads_of
from printctl.machine.printing.job_table import NONE, JobTable
from printctl.web.job.set_up import JobSetUp
from printctl.web.worker import lower_priority
from registration.report.gcode import Act, GcodeJob
from sim.gcode.dry_run.run import DryRun, dry_run

# Build a job's per-line progress table (time, ink, tip, layer, vessel) from its dry run.


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


_BUDGET: Final = "print time"
"""How the names of the checks begin that `file_checks` makes without changes of syringe."""


def check_job(gcode: Path, set_up: JobSetUp, table_file: Path) -> dict[str, Any]:
    """Check a job as `printctl print` does, and make its table.

    Returns
    -------
    dict
        ``sha256``, ``checks``, ``accepted``, ``reload_at``, ``reload_heads``, ``duration_s``,
        ``layers``, ``vessels``, ``passes``, ``ink`` and what cells have.

    Raises
    ------
    PrintctlError, ProfileError, OSError
    """
    data = gcode.read_bytes()
    mounted = set_up.mounted()
    run = dry_run(data, mounted.printer, set_up.start_mm)
    job = parse_job(data, gcode.name, mounted.printer)
    shaft = file_shaft(gcode, run, mounted, accepted=set_up.accept_crossings)
    results = [*file_checks(run, mounted, gcode.with_suffix(".map.npz")), *shaft.checks]
    checks, at, heads = with_reloads_of(
        [one for one in results if _BUDGET not in one.check],
        job,
        set_up.usable_mm(mounted),
        wanted=set_up.care.reload,
        by="allow changes of syringe",
    )
    budget = set_up.budget(mounted)
    time = PrintTime(run.duration_s, len(at), set_up.care.reload_min)
    checks += viability_checks(time, budget)
    loads = [mounted.load_of(k) for k in range(mounted.printer.head_count)]
    view = _view(gcode, data, mounted)
    table = make_table(job, run, volumes(run, mounted.printer, loads), view)
    table.save(table_file)
    return {
        "sha256": hashlib.sha256(data).hexdigest(),
        "checks": [_with_accepted(one, shaft.accepted).as_dict() for one in checks],
        "accepted": list(shaft.accepted),
        "reload_at": list(at),
        "reload_heads": list(heads),
        "duration_s": run.duration_s,
        "commands": len(job),
        "layers": table.layer_count,
        "vessels": table.vessel_count,
        "passes": table.passes,
        "ink_ul": float(table.ink_ul[-1]),
        **_ink_of_check(run, mounted, len(at)),
        **viability_facts(time, budget),
    }


def _with_accepted(check: Check, accepted: tuple[str, ...]) -> Check:
    """Let a warning say what is accepted: it is still to be read by whoever accepts it."""
    if not accepted or check.passed or check.refuses:
        return check
    return replace(check, remedy=check.remedy or accepted[0])


def _view(gcode: Path, data: bytes, mounted: SetUp) -> GcodeJob | None:
    """Layers and vessels of the job; None where nothing is written."""
    lines = data.count(b"\n") + (not data.endswith(b"\n"))
    mapped, _ = read_line_map(gcode, lines)
    syringe = mounted.syringe
    pushing = Pushing(mounted.printer, None, "", syringe.inner_mm, syringe.name)
    try:
        return read_job(data, gcode.name, pushing, mapped)
    except UsageError:
        return None


def _ink_of_check(run: DryRun, mounted: SetUp, reloads: int) -> dict[str, Any]:
    """Ink to be mixed; left out of several heads, each of which has its own."""
    if mounted.printer.heads or mounted.printer.pneumatic is not None:
        return {}
    return ink_use(run, mounted.printer, mounted.syringe, mounted.needle, None, reloads).facts()


def main() -> None:
    """Answer one question."""
    lower_priority()
    try:
        asked = json.loads(sys.stdin.readline())
        set_up = JobSetUp.model_validate(asked["set_up"])
        answer = check_job(Path(asked["gcode"]), set_up, Path(asked["table"]))
    except Exception as exc:
        known = message_and_code(exc)
        if known is None and not isinstance(exc, (PrintctlError, ProfileError, OSError)):
            raise
        answer = {"error": known[0] if known else str(exc)}
    print(json.dumps(answer), flush=True)
