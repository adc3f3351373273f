"""Predict the ink that a G-code file lays in the bath; write files where they are wanted."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from design.network import VesselNetwork
from gcode.bead.predict import swell
from gcode.dry_run.run import DryRun
from printctl.checks.bead import (
    InkPrediction,
    OutputFiles,
    VesselDiameters,
    predict_job,
    prediction_facts,
    vessel_diameters,
    write_prediction,
    written_filaments,
)
from printctl.checks.gcode_view import read_line_map
from printctl.checks.set_up import SetUp
from printctl.errors import UsageError
from printctl.pipeline.job.bead_choices import BeadChoices
from printctl.pipeline.job.lumens_in_gcode import place_of_filaments, read_designed

Say = Callable[[str], None]


def write_predictions(
    file: Path,
    gcode: bytes,
    run: DryRun,
    setup: SetUp,
    choices: BeadChoices,
    remarks: tuple[tuple[int, str], ...],
    say: Say,
) -> list[dict[str, Any]]:
    """Predict, write what is wanted, and give a dict for each head.

    `remarks` are lines of the file and what was found there otherwise, for the page; ``say`` gets
    what the user should know.

    Raises
    ------
    UsageError
        For options without what they belong to; when nothing is written, or the part's place
        can't be told.
    """
    wanted = replace(_wanted(choices), title=file.name, remarks=remarks)
    lines = gcode.count(b"\n") + (not gcode.endswith(b"\n"))
    line_map, notes = read_line_map(file, lines)
    for note in notes:
        say(f"note: {note}")
    loads = [setup.load_of(number) for number in range(setup.printer.head_count)]
    heads = predict_job(run, gcode, setup.printer, loads, line_map, choices.lag_s)
    held = _against_design(heads, choices, say)
    facts = []
    for one in heads:
        own = {head: pair for head, *pair in held}.get(one.head, (None, None))
        facts.append(prediction_facts(one, setup.bath, *own))
    if choices.out is not None:
        written = write_prediction(choices.out, heads, held, facts, wanted)
        facts[0]["files"] = [str(choices.out / name) for name in written]
    return facts


def _wanted(choices: BeadChoices) -> OutputFiles:
    for option, value in (("--voxel-um", choices.voxel_um), ("--window-s", choices.window_s)):
        if value is not None and choices.out is None:
            raise UsageError(f"{option} says how a file is written; give --out FOLDER, too")
    if choices.place_mm is not None and choices.network is None:
        raise UsageError("--place is where a network's origin stands; give --network, too")
    window = None if choices.window_s is None else _window(choices.window_s)
    return OutputFiles(None if choices.voxel_um is None else choices.voxel_um * 1e-3, window)


def _window(text: str) -> tuple[float, float]:
    try:
        low, high = (float(word) for word in text.split(","))
    except ValueError as exc:
        raise UsageError(f"--window-s {text!r} isn't FROM,TO in s; write it like 0,30") from exc
    if not (math.isfinite(low) and math.isfinite(high) and 0 <= low < high):
        raise UsageError(f"--window-s {text!r}: FROM must be 0 or more, and TO above it")
    return low, high


def _against_design(
    heads: tuple[InkPrediction, ...], choices: BeadChoices, say: Say
) -> list[tuple[int, VesselDiameters, VesselDiameters | None]]:
    """Vessels of each head, with and without lag; empty without a network."""
    if choices.network is None:
        return []
    if any(one.bead.style == "layered" for one in heads):
        raise UsageError(
            "--network: layers leave vessels open between their lines; printctl lumens measures "
            "those, and predicted_layers.csv has the lines"
        )
    if any(one.of_vessels is not True for one in heads):
        raise UsageError(
            "--network: which line is of which vessel stands in FILE.map.npz beside the file, "
            "which isn't there or counts layers; printctl toolpath writes it"
        )
    if any(one.of_strands for one in heads):
        raise UsageError(
            "--network: the file writes vessels as several strands side by side, and one strand is "
            "no vessel; the run's dry_run.json has their predicted diameters"
        )
    network = read_designed(choices.network, choices.unit, say)
    place = place_of_filaments(
        choices.place_mm, written_filaments([one.prompt for one in heads]), network
    )
    return [(one.head, *_both(one, network, place)) for one in heads]


def _both(
    one: InkPrediction, network: VesselNetwork, place: np.ndarray
) -> tuple[VesselDiameters, VesselDiameters | None]:
    factor = swell(one.mounting.ink)[0]
    late = vessel_diameters(one.bead, one.source, network, place, factor)
    if one.bead is one.prompt or one.ahead_s > 0:
        return late, None
    return late, vessel_diameters(one.prompt, one.prompt_source, network, place, factor)
