"""Print stage of a plate: a single part's print stage, its progress naming the current well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from printctl.machine.link.job import load_job
from printctl.pipeline.context import RunContext
from printctl.pipeline.plate.job import NOWHERE
from printctl.pipeline.plate.wells import PlateRun
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages import printing
from printctl.progress import Report
from printctl.run_folder.artefacts import GCODE, LINE_MAP


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
