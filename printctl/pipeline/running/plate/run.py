"""Run a recipe over a well plate: design variants, print one joined job, register scanned wells."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from gcode.motion.executed import ExecutedMotion
from printctl.errors import PrinterFailedError, SafetyError
from printctl.machine.job.job import load_job
from printctl.pipeline.context import RunContext
from printctl.pipeline.plate_plan import StandingPlate
from printctl.pipeline.run_options import SIMULATED_PORT
from printctl.pipeline.running.plate.dry_run import dry_run_stage
from printctl.pipeline.running.plate.job import NOWHERE, job_stage
from printctl.pipeline.running.plate.results import collect_plate, write_results, write_table
from printctl.pipeline.running.plate.wells import PlateRun, check_fit, make_folders, plate_run
from printctl.pipeline.running.run_stages import DESIGN, begin_facts, run_stages, run_under_one_bar
from printctl.pipeline.running.sequences import JOB
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages import printing, registration, report, scan
from printctl.pipeline.stages.collect import collect
from printctl.pipeline.stages.paths.toolpath import PATH
from printctl.pipeline.stages.printing import EXECUTED
from printctl.progress import Report
from printctl.run_folder.artefacts import GCODE, LINE_MAP


def cut_stage(run: PlateRun) -> Stage:
    """The stage that stands in a well's run for its print."""

    def depends(context: RunContext) -> Any:
        record = run.whole.manifest.stages["print"]
        assert context.stand is not None
        return [context.stand.well, record.outputs, record.summary["state"]]

    def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
        whole = run.whole.manifest.stages["print"].summary
        if run.whole.recipe.printer.port != SIMULATED_PORT or not run.whole.printer.streamed:
            return dict(whole), []
        assert context.stand is not None
        motion = ExecutedMotion.load(run.whole.folder / EXECUTED)
        cut = motion_in_well(motion, run.standing, context.stand.well)
        # The way down to the part: a file is held against a motion from where both begin.
        cut.start[0] = context.start_mm
        cut.save(context.folder / EXECUTED)
        lasted = float(cut.time_end[-1] - cut.time_start[0])
        return {**whole, "blocks": len(cut), "duration_s": lasted}, [EXECUTED]

    return Stage("print", depends, (), ("gcode", "sim"), work)


def motion_in_well(motion: ExecutedMotion, standing: StandingPlate, well: str) -> ExecutedMotion:
    """Blocks that begin and end nearer to a well's middle than half a pitch along each axis.

    Raises
    ------
    PrinterFailedError
        When there are none.
    """
    plate = standing.plate
    half = np.abs(standing.turned(plate.pitch_x_mm / 2, plate.pitch_y_mm / 2))
    centre = np.array(standing.centre_mm(well))
    inside = np.all(
        [(np.abs(at[:, :2] - centre) < half).all(axis=1) for at in (motion.start, motion.end)],
        axis=0,
    )
    if not inside.any():
        raise PrinterFailedError(
            f"the simulated printer's record has no motion in well {well}; see print/sim.log"
        )
    return ExecutedMotion(
        **{item.name: getattr(motion, item.name)[inside] for item in fields(motion)}
    )


def print_stage(run: PlateRun) -> Stage:
    """The stage of a single part's print, its progress told by wells."""

    def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
        return printing.work(context, _naming(run, report))

    return replace(printing.STAGE, work=work)


def _naming(run: PlateRun, report: Report) -> Report:
    """The same report with the well that is being printed in its note."""
    job = load_job(run.whole.folder / GCODE, run.whole.printer)
    with np.load(run.whole.folder / LINE_MAP, allow_pickle=False) as data:
        well = data["well"][np.array(job.file_lines) - 1]

    def told(fraction: float, note: str = "") -> None:
        at = int(well[min(round(fraction * len(well)), len(well) - 1)])
        if at != NOWHERE:
            one = run.wells[at]
            note = f"{one.name} ({one.label}), {note}"
        report(fraction, note)

    return told


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
    begin_facts(whole)
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
