"""Run a recipe over a well plate: design variants, print one joined job, register scanned wells."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

from printctl.errors import SafetyError
from printctl.pipeline.context import RunContext
from printctl.pipeline.design_stages import DESIGN
from printctl.pipeline.facts import run_facts
from printctl.pipeline.plate.cut import cut_stage
from printctl.pipeline.plate.dry_run import dry_run_stage
from printctl.pipeline.plate.fit import check_fit
from printctl.pipeline.plate.job import job_stage
from printctl.pipeline.plate.printing import print_stage
from printctl.pipeline.plate.results import collect_plate, write_results, write_table
from printctl.pipeline.plate.wells import PlateRun, make_folders, plate_run
from printctl.pipeline.sequences import JOB
from printctl.pipeline.stage import Stage, run_stages, run_under_one_bar
from printctl.pipeline.stages import registration, report, scan
from printctl.pipeline.stages.collect import collect
from printctl.pipeline.stages.toolpath import PATH


def design_plate(whole: RunContext) -> dict[str, Any]:
    """Design every variant in its own folder; give the plate and the first one's numbers."""
    run = _begin(whole)
    first = next(iter(run.runs.values()))
    return {**collect(first), "wells": collect_plate(run, {})["wells"]}


def toolpath_plate(whole: RunContext) -> dict[str, Any]:
    """As far as the plate's checked job."""
    run = _job(whole)
    data = collect_plate(run, {})
    write_table(run, data["wells"])
    return data


def run_plate(whole: RunContext, pdf: bool = False) -> dict[str, Any]:
    """Print the plate; scan, register and report its scanned wells; report the whole.

    Raises
    ------
    PrintctlError, DesignError, RegistrationError, LinkError, ProfileError, OSError
        Whatever stopped it; finished stages are kept and reused by the next run.
    """
    run = _job(whole)
    run_stages(whole, (print_stage(run),), whole.bars)
    after = (cut_stage(run), scan.STAGE, registration.STAGE)
    scans = {}
    for name in run.scanned:
        context = run.runs[name]
        run_stages(context, after, whole.bars)
        scans[name] = report.write_report(context, pdf)
    return write_results(run, scans)


def _begin(whole: RunContext) -> PlateRun:
    """Everything that can be refused before hours are spent, then the designs."""
    run = plate_run(whole)
    whole.manifest.facts = run_facts(whole)
    whole.manifest.save()
    make_folders(run)
    _each(run, DESIGN, "design")
    for context in run.runs.values():
        check_fit(context)
    return run


def _job(whole: RunContext) -> PlateRun:
    run = _begin(whole)
    _each(run, JOB, "job")
    _tell_the_same(run)
    run_stages(whole, (job_stage(run), dry_run_stage(run)), whole.bars)
    return run


def _each(run: PlateRun, stages: Sequence[Stage], what: str) -> None:
    for context in run.runs.values():
        try:
            run_under_one_bar(context, stages, run.whole.bars, f"{context.title} {what}")
        except SafetyError as exc:
            well = next(well for well in run.wells if well.name == context.title)
            raise SafetyError(f"well {well.name} ({well.label}): {exc}") from exc


def _tell_the_same(run: PlateRun) -> None:
    """Say where two variants come out as the same moves: what is varied then does nothing."""
    seen: dict[str, RunContext] = {}
    firsts = {run.first_of(well.variant).name: well for well in run.wells}
    for name, well in firsts.items():
        context = run.runs[name]
        data = (context.folder / PATH).read_bytes() + repr(context.ink.flow_factor).encode()
        other = seen.setdefault(hashlib.sha256(data).hexdigest(), context)
        if other is not context:
            run.whole.bars.remark(
                "toolpath",
                f"wells {other.folder.name} and {name} get the same moves, though {well.label} is "
                "varied between them: what differs doesn't touch the path",
            )
