"""Join all wells' toolpaths into one plate job; write its G-code, and the map of lines to wells."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.toolpath import Toolpath
from design.toolpath.gcode import Gcode, add_labels, save_gcode, stream_gcode
from design.toolpath.gcode.numbers import dialect_of
from design.toolpath.toolpath import load_toolpath
from design.toolpath.wells import Trip, place_in_well, with_approach, written_ul
from kernels.arrays import FloatArray
from printctl.pipeline.context import RunContext
from printctl.pipeline.plate.job_map import (
    bundles_of,
    first_sources,
    wells_in_map,
    written_in_all,
)
from printctl.pipeline.plate.wells import PlateRun, relative
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.toolpath import PATH, machine
from printctl.progress import Report
from printctl.run_folder.artefacts import GCODE, LINE_MAP

NOWHERE: Final = -1
"""In the map, of a line between wells."""


@dataclass
class WellPaths:
    """What is known of the wells once their paths are laid.

    Attributes
    ----------
    first, after : list of int
        Moves of the whole job: the first of each well, and the first one after it.
    written_ul : list of float
        Ink that its writing moves take.
    moves : int
        Of all so far.
    well_of_line : list of arrays
        Well of each line, in the printing order; `NOWHERE` between wells.
    """

    first: list[int] = field(default_factory=list)
    after: list[int] = field(default_factory=list)
    written_ul: list[float] = field(default_factory=list)
    moves: int = 0
    well_of_line: list[NDArray[np.int16]] = field(default_factory=list)


def job_stage(run: PlateRun) -> Stage:
    """The stage that writes the plate's job; its name is the toolpath's."""
    paths = tuple(relative(run, context, PATH) for context in run.runs.values())

    def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
        return write_job(run, report)

    return Stage("toolpath", lambda _: _depends(run), paths, ("kernels", "design"), work)


def _depends(run: PlateRun) -> Any:
    whole = run.whole
    return [
        [[well.name, well.label, well.copy, run.folder_of(well)] for well in run.wells],
        [run.standing.centre_mm(well.name) for well in run.wells],
        [run.place_of(well).tolist() for well in run.wells],
        [run.standing.safe_z_mm, run.standing.bath_mm, run.standing.turned_deg],
        run.standing.plate.model_dump(mode="json"),
        whole.start_mm.tolist(),
        [one.model_dump(mode="json") for one in (whole.printer, whole.syringe, whole.profile_ink)],
        [context.ink_changes.get("flow_factor") for context in run.runs.values()],
        whole.flow_ul_s,
    ]


def write_job(run: PlateRun, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Lay the paths end to end, write them as one job with a label at each well, and its map."""
    whole, laid = run.whole, WellPaths()
    kept = {name: load_toolpath(of.folder / PATH) for name, of in run.runs.items()}
    paths = {well.name: kept[run.run_of(well).folder.name] for well in run.wells}
    bundles = bundles_of(run)
    top = max(
        run.standing.safe_z_mm,
        *(paths[well.name].top_mm + run.place_of(well)[2] for well in run.wells),
    )
    printer, syringe, _, options = machine(whole, ahead=False)
    parts = _parts(run, paths, laid, first_sources(bundles))
    written = stream_gcode(parts, printer, syringe, np.zeros(3), options, top)
    # Filled while the job is written; save_gcode reads it when that is done.
    beside: dict[str, NDArray[Any]] = {}
    job = _marked(run, written, laid, beside, report)
    if bundles is not None:
        beside |= written_in_all(run, bundles)
        if not bundles.whole.is_plain:
            job = bundles.whole.of_design(job, beside)
    lines = save_gcode(whole.folder / GCODE, whole.folder / LINE_MAP, job, beside)
    summary = {
        "method": whole.recipe.toolpath.method,
        "moves": laid.moves,
        "written_ul": sum(laid.written_ul),
        "lines": lines,
        "plate": run.standing.plate.name,
        "wells": len(run.wells),
        "variants": len({well.variant for well in run.wells}),
    }
    return summary, [GCODE, LINE_MAP]


def _parts(
    run: PlateRun, paths: dict[str, Toolpath], laid: WellPaths, sources: Iterator[int]
) -> Iterator[Toolpath]:
    """Each well's path with the way to it, in the printer's frame."""
    at: FloatArray | None = None
    before = run.whole
    for well, number in zip(run.wells, sources, strict=False):
        of = run.run_of(well)
        doses = run.whole.ink.flow_factor / of.ink.flow_factor
        path = place_in_well(paths[well.name], run.place_of(well), doses, number)
        laid.written_ul.append(written_ul(path) / doses)
        way = 0
        if at is not None:
            path, way = with_approach(path, at, _trip(run, before, of))
        laid.first.append(laid.moves + way)
        laid.moves += len(path)
        laid.after.append(laid.moves)
        at, before = path.end[-1], of
        yield path


def _trip(run: PlateRun, before: RunContext, to: RunContext) -> Trip:
    speed = to.recipe.toolpath.travel_speed_mm_s
    return Trip(run.standing.safe_z_mm, speed, before.ink.retract_ul, before.ink.plunger_ul_s)


def _marked(
    run: PlateRun,
    parts: Iterator[Gcode],
    laid: WellPaths,
    beside: dict[str, NDArray[Any]],
    report: Report,
) -> Iterator[Gcode]:
    """The job's parts with a comment where a well begins and ends."""
    comment = dialect_of(run.whole.printer).comment
    for number, (well, part) in enumerate(zip(run.wells, parts, strict=True)):
        report((number + 1) / len(run.wells), f"well {well.name}")
        first, after = laid.first[number], laid.after[number]
        texts = {first: f"WELL:{well.name} {well.label}", after: f"WELL_END:{well.name}"}
        labelled = add_labels(part, texts, comment)
        inside = (labelled.line_move >= first) & (labelled.line_move < after)
        laid.well_of_line.append(np.where(inside, number, NOWHERE).astype(np.int16))
        yield labelled
    beside |= wells_in_map(run, laid.well_of_line)
