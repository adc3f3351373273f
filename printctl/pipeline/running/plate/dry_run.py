"""Simulate a plate's G-code, and check it as a single part's job and well by well."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.files import write_text
from gcode.dry_run.run import DryRun, dry_run
from gcode.program.gcode import Program
from kernels.arrays import BoolArray
from printctl.checks.kinds import Kind
from printctl.checks.preflight import (
    Check,
    Designed,
    compare_well_moves,
    refuse_failed,
    volumes,
    warnings,
)
from printctl.checks.preflight.set_up import read_map_wells
from printctl.checks.set_up import finding
from printctl.errors import PrintctlError
from printctl.pipeline.context import RunContext
from printctl.pipeline.plate_plan import Well
from printctl.pipeline.run_options import SIMULATED_PORT
from printctl.pipeline.running.plate.job import NOWHERE
from printctl.pipeline.running.plate.wells import PlateRun, relative
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.paths import dry_run as alone
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
    parts = [run.run_of(well).recipe.toolpath for well in run.wells]
    allowed = sum(0 if isinstance(part, Fresh) else part.allowed_crossings for part in parts)
    found = alone.checked(whole, _designed(run), allowed)
    report(0.4, "looking at each well")
    of_line = _well_of_line(whole.folder / LINE_MAP)
    times = well_times(run, found.run, of_line)
    if read_map_wells(found.run, found.set_up, whole.folder / LINE_MAP) is None:
        raise PrintctlError(f"{LINE_MAP} names no wells; take it away and run again")
    checks = [*found.checks, *_as_alone(run, found.run.program, of_line), *_place(run)]
    summary = {
        **alone.summary_of(whole, found),
        "checks": [check.as_dict() for check in checks],
        "wells": times,
    }
    write_text(whole.folder / alone.CHECKS, json.dumps(summary, indent=1) + "\n")
    refuse_failed(checks)
    for text in warnings(checks):
        whole.bars.remark("dry run", text)
    return summary, [alone.CHECKS]


def _designed(run: PlateRun) -> Designed:
    """The deepest part and the widest filament of all wells; ink where its factor is varied."""
    each = [alone.designed(context) for context in run.runs.values()]
    return Designed(
        max(one.depth_mm for one in each),
        [max(one.widest_mm[0] for one in each)],
        run.whole.recipe.toolpath.written,
        {well.name: _ink_factor(run, well) for well in run.wells},
    )


def _ink_factor(run: PlateRun, well: Well) -> float:
    """What comes out in a well over what the plate's ink would give, where the factor is swept."""
    return run.run_of(well).ink.flow_factor / run.whole.ink.flow_factor


def _well_of_line(path: Path) -> NDArray[np.int64]:
    with np.load(path, allow_pickle=False) as data:
        return np.asarray(data["well"], dtype=np.int64)


def _place(run: PlateRun) -> list[Check]:
    """Before a real print: nobody said where A1 is."""
    if run.part.a1_mm is not None or run.whole.recipe.printer.port == SIMULATED_PORT:
        return []
    x, y = run.standing.centre_mm("A1")
    return [
        finding(
            Kind.PLATE_PLACE,
            "place of the plate",
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
    ink_ul = pushed_ul * _ink_factor(run, well)
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
