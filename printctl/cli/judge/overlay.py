"""`printctl overlay`: gaps and misplaced gel in a scan, layer by layer against the G-code."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Literal

from printctl.cli.declare import json_command
from printctl.cli.judge.scan import ScanFile, ScanOptions
from printctl.cli.options import OutFolder, messages, print_result
from printctl.pipeline.judging import overlaying
from printctl.pipeline.prepared.written_layers import read_written
from printctl.progress import StageBars
from printctl.settings import opt
from registration.corrected import corrected_scan
from registration.options import RegistrationOptions, segmentation_options
from registration.overlay import align_pose, read_pose
from registration.segmentation import segment


@json_command
def overlay(
    *,
    scan: ScanFile,
    model: Path = opt("Run folder of a print in layers.", ...),
    out: OutFolder,
    pose: Path | None = opt(
        "registration.json of a scan in the same place; then nothing is aligned."
    ),
    fit: Literal["scaled", "rigid"] = opt(
        "Whether the pose may stretch the scan to the design's size.", "scaled"
    ),
    layer: list[int] | None = opt("Layer number, from 1; may be repeated.", min=1),
    scan_said: ScanOptions,
) -> None:
    """Lay a scan over the lines that a print in layers wrote: gaps, and gel in lumens.

    A scan taken while the part is printed can't be aligned by itself: give --pose.
    """
    options = RegistrationOptions(lumens="bright" if scan_said.filled else "dark")
    known = None if pose is None else read_pose(pose, fit)
    run = read_written(model, messages(), fit)
    chosen = overlaying.chosen_layers(run.layers, layer or [])
    overrides, optics = scan_said.overrides(), scan_said.oct_calibration
    bars, air, walls = StageBars(messages()), scan_said.air_above, scan_said.walls
    with bars.all():
        with bars.stage("scan"):
            measured = corrected_scan(scan, overrides, optics, air, walls=walls)
        with bars.stage("segmentation"):
            how = segmentation_options(measured, options, run.thinnest_mm)
            segmentation = segment(measured, replace(how, whole_part=True))
        with bars.stage("pose"):
            known = known or align_pose(measured, segmentation, run.solid, fit)
        with bars.stage("measuring") as report:
            laid = overlaying.overlay_scan(run, measured, segmentation, known, report)
        with bars.stage("drawing") as report:
            facts = {"schema": 1, "scan": str(scan), "model": str(model)}
            facts |= {"walls": None if measured.walls is None else asdict(measured.walls)}
            data = overlaying.write_overlay(out, laid, chosen, facts, report)
    lines = [known.said, *known.notes, *overlaying.summary_lines(data), str(out / overlaying.HTML)]
    print_result(data, lines)
