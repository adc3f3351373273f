"""Cut one well's moves out of the executed motion of a simulated plate print."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from printctl.errors import PrinterFailedError
from printctl.pipeline.context import SIMULATED_PORT, RunContext
from printctl.pipeline.plate.wells import PlateRun
from printctl.pipeline.plates import StandingPlate
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.printing import EXECUTED
from printctl.progress import Report
from sim.gcode.motion.executed import ExecutedMotion


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

    return Stage("print", depends, (), ("sim",), work)


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
