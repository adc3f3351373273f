"""Predict a run's ink deposit from its dry run; write tables, a playback page and time plots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from design.toolpath.embedded import Bundles
from gcode.bead.predict import Bead, swell
from gcode.dry_run.run import DryRun, dry_run
from gcode.heads import with_commands
from gcode.motion.executed import ExecutedMotion
from printctl.checks.bead import (
    InkPrediction,
    OutputFiles,
    VesselDiameters,
    merge_bundles,
    predict_job,
    prediction_facts,
    vessel_diameters,
    write_prediction,
)
from printctl.checks.gcode_view.line_map import LineMap, read_line_map
from printctl.pipeline.context import RunContext
from printctl.pipeline.stages.paths.toolpath import plain_job, written_bundles
from printctl.recipe.sections.toolpath import Embedded
from printctl.run_folder.artefacts import GCODE


def predicting(
    context: RunContext, run: DryRun, gcode: bytes, remarks: tuple[tuple[int, str], ...] = ()
) -> tuple[list[Any], list[str]]:
    """Predict, write tables, page and time lines, and give facts of each head, JSON-ready.

    `remarks` are lines of the file and what was found there otherwise, for the page.
    """
    lines = gcode.count(b"\n") + (not gcode.endswith(b"\n"))
    line_map, _ = read_line_map(context.folder / GCODE, lines)
    heads = _predicted(context, run, gcode, line_map)
    held = []
    if isinstance(context.recipe.toolpath, Embedded):
        bundles = written_bundles(context)
        strand = None if line_map is None else line_map.strand
        held = [(one.head, *_both(context, bundles, one, strand)) for one in heads]
    by_head = {head: pair for head, *pair in held}
    facts = [prediction_facts(one, context.bath, *by_head.get(one.head, ())) for one in heads]
    wanted = OutputFiles(title=context.recipe.name, keep_play=True, remarks=remarks)
    files = write_prediction(context.folder, heads, held, facts, wanted)
    if compensates(context):
        facts[0]["vessels_uncompensated"] = _uncompensated(context).facts()
    return facts, files


def compensates(context: RunContext) -> bool:
    """Whether the job's E is ahead of the ink's lag, so that E alone doesn't say what is laid."""
    part = context.recipe.toolpath
    return isinstance(part, Embedded) and part.compensate_lag


def predicted_of_motion(
    context: RunContext,
    run: DryRun,
    gcode: bytes,
    motion: ExecutedMotion | None = None,
    file_row: Sequence[int] | None = None,
) -> InkPrediction:
    """What the one head of a compensated job lays, by the dry run's motion or a printer's.

    ``file_row``: of each row of ``gcode`` the run's, from 0, where something was inserted; -1.
    """
    if motion is not None:
        run = replace(run, executed=with_commands(motion, run.program))
    lines = gcode.count(b"\n") + (not gcode.endswith(b"\n"))
    rows = range(lines) if file_row is None else file_row
    line_map, _ = read_line_map(context.folder / GCODE, sum(row >= 0 for row in rows))
    if line_map is not None and file_row is not None:
        line_map = line_map.at_rows(file_row)
    return _predicted(context, run, gcode, line_map)[0]


def _predicted(
    context: RunContext, run: DryRun, gcode: bytes, line_map: LineMap | None
) -> tuple[InkPrediction, ...]:
    return predict_job(run, gcode, context.printer, context.loads, line_map)


def _both(
    context: RunContext, bundles: Bundles, one: InkPrediction, strand: np.ndarray | None
) -> tuple[VesselDiameters, VesselDiameters | None]:
    late = _held(context, bundles, one, one.bead, _strands(one.bead, one.source, strand))
    if one.bead is one.prompt or one.ahead_s > 0:
        return late, None
    source = _strands(one.prompt, one.prompt_source, strand)
    return late, _held(context, bundles, one, one.prompt, source)


def _strands(bead: Bead, source: np.ndarray, strand: np.ndarray | None) -> np.ndarray:
    """Strand of each piece; its vessel where each is one filament."""
    if strand is None:
        return source
    return np.where(bead.line > 0, strand[np.clip(bead.line - 1, 0, len(strand) - 1)], -1)


def _held(
    context: RunContext, bundles: Bundles, one: InkPrediction, bead: Bead, source: np.ndarray
) -> VesselDiameters:
    factor = swell(one.mounting.ink)[0]
    diameters = vessel_diameters(bead, source, bundles.network, context.place_mm, factor)
    return diameters if bundles.is_plain else merge_bundles(diameters, bundles.owner)


def _uncompensated(context: RunContext) -> VesselDiameters:
    """What the same plan would leave if the plunger weren't driven ahead of the lag."""
    plain = plain_job(context)
    x, y, z = context.start_mm.tolist()
    run = dry_run(plain.data, context.printer, (x, y, z))
    plain_map = LineMap(plain.line_source, True, plain.line_kind)
    one = _predicted(context, run, plain.data, plain_map)[0]
    return _held(context, written_bundles(context), one, one.bead, one.source)
