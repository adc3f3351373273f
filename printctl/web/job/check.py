"""Check a job in a process of its own; its tables."""

from __future__ import annotations

import hashlib
import json
import sys
from pathlib import Path
from typing import Any

from gcode.dry_run.run import DryRun
from printctl.checks.gcode_view import Pushing, read_job, read_line_map
from printctl.checks.made_for import is_recorded, read_made_for
from printctl.checks.preflight import SetUp, ink_use, volumes
from printctl.errors import UsageError
from printctl.failures import message_and_code
from printctl.pipeline.checked_order import checked_order
from printctl.pipeline.job.job_table import make_table
from printctl.web.job.set_up import JobSetUp
from printctl.web.worker import lower_priority
from report.gcode import GcodeJob


def check_job(gcode: Path, set_up: JobSetUp, table_file: Path) -> dict[str, Any]:
    """Check a job as `printctl print` does, and make its table.

    Return ``sha256``, ``checks``, ``offers_reload``, ``duration_s``, ``layers``, ``vessels``,
    ``passes``, ``ink``, what cells have, and what `Plan` has; no table of a job that can't be sent.
    """
    mounted = set_up.mounted()
    checked = checked_order(gcode, mounted, set_up.order_care)
    run, data = checked.run, checked.data
    table: dict[str, Any] = {"commands": 0, "layers": 0, "vessels": 0, "passes": False, "ink_ul": 0}
    if checked.job is not None:
        ul = volumes(run, mounted.printer, mounted.loads)
        rows = make_table(checked.job, run, ul, _view(gcode, data, mounted))
        rows.save(table_file)
        table = {
            "commands": len(checked.job),
            "layers": rows.layer_count,
            "vessels": rows.vessel_count,
            "passes": rows.passes,
            "ink_ul": float(rows.ink_ul[-1]),
        }
    return {
        "sha256": hashlib.sha256(data).hexdigest(),
        "checks": [one.as_dict() for one in checked.checks],
        "offers_reload": checked.offers_reload,
        "recorded": is_recorded(read_made_for(run.opening), mounted.printer),
        **table,
        **_ink_of_check(run, mounted, len(checked.plan.reload_at)),
        **checked.facts,
        **checked.plan.to_dict(),
    }


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
