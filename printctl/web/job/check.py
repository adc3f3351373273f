"""Dry-run and check a job, and write its progress table, in a process of `run_worker`.

A line of JSON comes in (`Question`), one goes out: what `check_job` gives, or ``{"error": ...}``.
The job's table (`printctl.machine.printing.job_table`) is written beside the answer's file.
"""

from __future__ import annotations

import hashlib
import json
import sys
from dataclasses import replace
from typing import Any, Final

from firmware_profiles import ProfileError
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
from printctl.machine.printing.job_table import JobTable
from printctl.web.job.check_request import Question
from printctl.web.job.tabulating import make_table
from printctl.web.low_priority import lower_priority
from registration.report.gcode import GcodeJob
from sim.gcode.dry_run.run import DryRun, dry_run

_BUDGET: Final = "print time"
"""How the names of the checks begin that `file_checks` makes without changes of syringe."""


def check_job(asked: Question) -> dict[str, Any]:
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
    data = asked.gcode.read_bytes()
    mounted = asked.set_up.mounted()
    run = dry_run(data, mounted.printer, asked.set_up.start_mm)
    job = parse_job(data, asked.gcode.name, mounted.printer)
    checks, at, heads, accepted = _checks(asked, run, job, mounted)
    table = _table(asked, data, run, job, mounted)
    table.save(asked.table)
    time = PrintTime(run.duration_s, len(at), asked.set_up.care.reload_min)
    return {
        "sha256": hashlib.sha256(data).hexdigest(),
        "checks": [check.as_dict() for check in checks],
        "accepted": list(accepted),
        "reload_at": list(at),
        "reload_heads": list(heads),
        "duration_s": run.duration_s,
        "commands": len(job),
        "layers": table.layer_count,
        "vessels": table.vessel_count,
        "passes": table.passes,
        "ink_ul": float(table.ink_ul[-1]),
        **_ink(run, mounted, len(at)),
        **viability_facts(time, asked.set_up.budget(mounted)),
    }


def _checks(
    asked: Question, run: DryRun, job: Job, mounted: SetUp
) -> tuple[list[Check], tuple[int, ...], tuple[int, ...], tuple[str, ...]]:
    set_up = asked.set_up
    shaft = file_shaft(asked.gcode, run, mounted, accepted=set_up.accept_crossings)
    results = [*file_checks(run, mounted, asked.gcode.with_suffix(".map.npz")), *shaft.checks]
    checks, at, heads = with_reloads_of(
        [one for one in results if _BUDGET not in one.check],
        job,
        set_up.usable_mm(mounted),
        wanted=set_up.care.reload,
        by="allow changes of syringe",
    )
    time = PrintTime(run.duration_s, len(at), set_up.care.reload_min)
    checks += viability_checks(time, set_up.budget(mounted))
    accepted = shaft.accepted
    if accepted:  # allowed, and still to be read by whoever allows it
        checks = [_told(one, accepted) for one in checks]
    return checks, at, heads, accepted


def _told(check: Check, accepted: tuple[str, ...]) -> Check:
    if check.passed or check.refuses:
        return check
    return replace(check, remedy=check.remedy or accepted[0])


def _table(asked: Question, data: bytes, run: DryRun, job: Job, mounted: SetUp) -> JobTable:
    loads = [mounted.load_of(k) for k in range(mounted.printer.head_count)]
    return make_table(job, run, volumes(run, mounted.printer, loads), _view(asked, data, mounted))


def _view(asked: Question, data: bytes, mounted: SetUp) -> GcodeJob | None:
    """Layers and vessels of the job; None where nothing is written."""
    lines = data.count(b"\n") + (not data.endswith(b"\n"))
    said_by_map, _ = read_line_map(asked.gcode, lines)
    syringe = mounted.syringe
    pushing = Pushing(mounted.printer, None, "", syringe.inner_mm, syringe.name)
    try:
        return read_job(data, asked.gcode.name, pushing, said_by_map)
    except UsageError:
        return None


def _ink(run: DryRun, mounted: SetUp, reloads: int) -> dict[str, Any]:
    """Ink to be mixed; left out of several heads, each of which has its own."""
    if mounted.printer.heads or mounted.printer.pneumatic is not None:
        return {}
    return ink_use(run, mounted.printer, mounted.syringe, mounted.needle, None, reloads).facts()


def main() -> None:
    """Answer one question."""
    lower_priority()
    try:
        answer = check_job(Question.from_json(sys.stdin.readline()))
    except Exception as exc:
        known = message_and_code(exc)
        if known is None and not isinstance(exc, (PrintctlError, ProfileError, OSError)):
            raise
        answer = {"error": known[0] if known else str(exc)}
    print(json.dumps(answer), flush=True)
