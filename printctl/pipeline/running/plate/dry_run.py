"""Simulate a plate's G-code, and check it as a single part's job and well by well."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.files import write_text
from gcode.clearance.check import Clearance
from gcode.dry_run.run import DryRun, dry_run
from gcode.program.gcode import Program
from kernels.arrays import BoolArray
from printctl.checks.preflight import (
    Check,
    bath_checks,
    compare_well_moves,
    gcode_checks,
    read_wells,
    refuse_failed,
    shaft_checks,
    volumes,
    warnings,
    well_checks,
)
from printctl.errors import PrintctlError
from printctl.machine.job.job import parse_job
from printctl.machine.job.syringes import usable_mm
from printctl.pipeline.context import RunContext
from printctl.pipeline.plate_plan import Well
from printctl.pipeline.run_options import SIMULATED_PORT
from printctl.pipeline.running.plate.job import NOWHERE
from printctl.pipeline.running.plate.wells import PlateRun, relative
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.paths import dry_run as alone
from printctl.pipeline.syringe_plan import plan_syringes
from printctl.progress import Report
from printctl.recipe.sections.toolpath import Fresh
from printctl.run_folder.artefacts import GCODE, LINE_MAP


def dry_run_stage(run: PlateRun) -> Stage:
    """The stage; its name is that of a single part's."""
    alone_jobs = tuple(
        relative(run, context, name) for context in run.runs.values() for name in (GCODE, LINE_MAP)
    )

    def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
        return check_job(run, report)

    def depends(context: RunContext) -> Any:
        care = context.recipe.printer.care
        return [
            alone.depends(context),
            run.standing.plate.model_dump(mode="json"),
            [run.standing.centre_mm(well.name) for well in run.wells],
            [care.reload_min, care.viability_min],
            [run.part.a1_mm, context.recipe.printer.port],
        ]

    reads = (GCODE, LINE_MAP, *alone_jobs)
    return Stage("dry run", depends, reads, ("kernels", "gcode", "sim", "firmware_profiles"), work)


def check_job(run: PlateRun, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Run the file through the planner; refuse when anything is wrong."""
    whole = run.whole
    data = (whole.folder / GCODE).read_bytes()
    x, y, z = whole.start_mm.tolist()
    checked = dry_run(data, whole.printer, (x, y, z))
    report(0.4, "looking at each well")
    of_line = _well_of_line(whole.folder / LINE_MAP)
    times = well_times(run, checked, of_line)
    planned = plan_syringes(
        _checks(run, checked, of_line, times),
        parse_job(data, GCODE, whole.printer),
        [usable_mm(whole.syringe, whole.printer)],
        [one.ink for one in whole.loads],
        checked.duration_s,
        whole.recipe.printer.care,
        by="say printer.care.reload: true",
    )
    report(0.8, "looking at the needle's shaft")
    clearance = alone.shaft(whole, checked)
    checks = [*planned.checks, *_shaft(run, clearance)]
    summary = {
        "duration_s": checked.duration_s,
        **planned.facts,
        **alone.ink_facts(whole, checked, planned.reload_at, planned.reload_heads),
        **alone.shaft_facts(clearance),
        "merged_moves": checked.merged_moves,
        "checks": [check.as_dict() for check in checks],
        "wells": times,
    }
    write_text(whole.folder / alone.CHECKS, json.dumps(summary, indent=1) + "\n")
    refuse_failed(checks)
    for text in warnings(checks):
        whole.bars.remark("dry run", text)
    return summary, [alone.CHECKS]


def _well_of_line(path: Path) -> NDArray[np.int64]:
    with np.load(path, allow_pickle=False) as data:
        return np.asarray(data["well"], dtype=np.int64)


def _checks(
    run: PlateRun, checked: DryRun, of_line: NDArray[np.int64], times: Sequence[dict[str, Any]]
) -> list[Check]:
    whole = run.whole
    inks = volumes(checked, whole.printer, whole.loads)
    wells = read_wells(whole.folder / LINE_MAP, checked.program.line, inks)
    if wells is None:
        raise PrintctlError(f"{LINE_MAP} names no wells; take it away and run again")
    # What comes out where the swept factor is the true one, as for every other check.
    wells = replace(wells, ink_ul={row["well"]: row["ink_ul"] for row in times})
    return [
        *gcode_checks(checked, whole.printer),
        *alone.of_mounted(whole, checked, whole.printer, 0),
        *well_checks(checked, wells, whole.needle),
        *_as_alone(run, checked.program, of_line),
        *_place(run),
        *bath_checks(whole.bath),
    ]


def _place(run: PlateRun) -> list[Check]:
    """Before a real print: nobody said where A1 is."""
    if run.part.a1_mm is not None or run.whole.recipe.printer.port == SIMULATED_PORT:
        return []
    x, y = run.standing.centre_mm("A1")
    return [
        Check(
            "place of the plate",
            0,
            0,
            "",
            False,
            "plate.a1_mm",
            f"isn't said, so A1 is taken to be at x {x:g}, y {y:g} mm, the plate in the middle of "
            "the work area; bring the tip over A1 and give what the printer shows",
            "warns",
        )
    ]


def _as_alone(run: PlateRun, program: Program, of_line: NDArray[np.int64]) -> list[Check]:
    """Hold each well against the run that checked what is printed in it."""
    whole = run.whole
    jobs = {context.folder.name: _alone(context) for context in run.runs.values()}
    checks = []
    for number, well in enumerate(run.wells):
        of = run.run_of(well)
        rows = of_line[program.line - 1] == number
        moved = run.place_of(well) - of.place_mm
        checks.append(
            compare_well_moves(
                well.name, (program, rows), jobs[of.folder.name], moved, whole.printer
            )
        )
    failed = [check for check in checks if not check.passed]
    return failed or [max(checks, key=lambda check: check.value)]


def _alone(context: RunContext) -> tuple[Program, BoolArray]:
    """A well's own job, and its rows that aren't the way in or out."""
    x, y, z = context.start_mm.tolist()
    program = dry_run((context.folder / GCODE).read_bytes(), context.printer, (x, y, z)).program
    with np.load(context.folder / LINE_MAP, allow_pickle=False) as data:
        own = np.asarray(data["move"]) >= 0
    return program, own[program.line - 1]


def well_times(run: PlateRun, checked: DryRun, of_line: NDArray[np.int64]) -> list[dict[str, Any]]:
    """Lines, ink and time of each well, in the printing order."""
    program, executed = checked.program, checked.executed
    inks = volumes(checked, run.whole.printer, run.whole.loads)
    well = of_line[program.line - 1]
    of_command = np.full(int(program.command.max()) + 1, NOWHERE)
    of_command[program.command] = well
    blocks = np.where(executed.line >= 0, of_command[executed.line], NOWHERE)
    return [
        _row(run, one, program.line[well == k], float(inks[well == k].sum()), times)
        for k, one in enumerate(run.wells)
        for times in [(executed.time_start[blocks == k], executed.time_end[blocks == k])]
    ]


def _row(
    run: PlateRun, well: Well, lines: NDArray[np.int64], pushed_ul: float, times: Any
) -> dict[str, Any]:
    # What comes out where the swept factor is the true one, as for every other check.
    ink_ul = pushed_ul * run.run_of(well).ink.flow_factor / run.whole.ink.flow_factor
    begins, ends = times
    x, y = run.standing.centre_mm(well.name)
    return {
        "well": well.name,
        "label": well.label,
        "values": dict(well.point.values),
        "copy": well.copy,
        "run": run.folder_of(well),
        "x_mm": x,
        "y_mm": y,
        "first_line": int(lines.min()),
        "last_line": int(lines.max()),
        "ink_ul": round(ink_ul, 4),
        "begins_s": round(float(begins.min()), 2),
        "lasts_s": round(float(ends.max() - begins.min()), 2),
    }


def _shaft(run: PlateRun, clearance: Clearance | None) -> list[Check]:
    """Of all wells together, as many crossings as their recipes allow together."""
    parts = [run.run_of(well).recipe.toolpath for well in run.wells]
    if clearance is None:
        return []
    return shaft_checks(
        clearance, sum(0 if isinstance(part, Fresh) else part.allowed_crossings for part in parts)
    )
