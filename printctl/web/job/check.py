"""Check a job in a process of its own; its tables."""

from __future__ import annotations

import hashlib
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from gcode.dry_run.run import DryRun, dry_run
from printctl.checks.gcode_view import Pushing, read_job, read_line_map
from printctl.checks.made_for import is_recorded, read_made_for
from printctl.checks.preflight import (
    Check,
    SetUp,
    file_checks,
    ink_use,
    volumes,
)
from printctl.checks.preflight.shaft import file_shaft
from printctl.errors import UsageError
from printctl.failures import message_and_code
from printctl.machine.job.job import parse_job
from printctl.pipeline.job.job_table import make_table
from printctl.pipeline.syringe_plan import plan_syringes
from printctl.web.job.set_up import JobSetUp
from printctl.web.worker import lower_priority
from report.gcode import GcodeJob


def check_job(gcode: Path, set_up: JobSetUp, table_file: Path) -> dict[str, Any]:
    """Check a job as `printctl print` does, and make its table.

    Return ``sha256``, ``checks``, ``accepted``, ``reload_at``, ``reload_heads``, ``duration_s``,
    ``layers``, ``vessels``, ``passes``, ``ink`` and what cells have.
    """
    data = gcode.read_bytes()
    mounted = set_up.mounted()
    run = dry_run(data, mounted.printer, set_up.start_mm)
    job = parse_job(data, gcode.name, mounted.printer)
    shaft = file_shaft(gcode, run, mounted, accepted=set_up.accept_crossings)
    line_map = gcode.with_suffix(".map.npz")
    results = [*file_checks(run, mounted, line_map, lifted=True), *shaft.checks]
    plan = plan_syringes(
        results,
        job,
        set_up.usable_mm(mounted),
        mounted.inks,
        run.duration_s,
        set_up.care,
        by="allow changes of syringe",
    )
    loads = [mounted.load_of(k) for k in range(mounted.printer.head_count)]
    view = _view(gcode, data, mounted)
    table = make_table(job, run, volumes(run, mounted.printer, loads), view)
    table.save(table_file)
    return {
        "sha256": hashlib.sha256(data).hexdigest(),
        "checks": [_with_accepted(one, shaft.accepted).as_dict() for one in plan.checks],
        "accepted": list(shaft.accepted),
        "recorded": is_recorded(read_made_for(run.opening), mounted.printer),
        "duration_s": run.duration_s,
        "commands": len(job),
        "layers": table.layer_count,
        "vessels": table.vessel_count,
        "passes": table.passes,
        "ink_ul": float(table.ink_ul[-1]),
        **_ink_of_check(run, mounted, len(plan.reload_at)),
        **plan.facts,
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
        if known is None:
            raise
        answer = {"error": known[0]}
    print(json.dumps(answer), flush=True)
