"""`printctl simulate`: dry-run and check a G-code file; optionally predict the ink in the bath."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from firmware_profiles import Printer, load
from gcode.dry_run.run import dry_run
from printctl.checks.preflight import (
    PrintTime,
    file_checks,
    placed_failures,
    viability_checks,
    warnings,
)
from printctl.checks.preflight.shaft import file_shaft
from printctl.checks.set_up import ProfileNames, refusal_of, set_up, shortest_budget
from printctl.cli import options as cli
from printctl.cli.declare import json_command, wants_json
from printctl.cli.kernels_ready import have_kernels
from printctl.errors import UsageError
from printctl.failures import error_facts
from printctl.machine.control.board.connecting import ASIDE_MM
from printctl.machine.errors import LinkError
from printctl.machine.job.coordinates import declared_start
from printctl.machine.job.job import parse_job
from printctl.machine.prints.mounted import ASSUMED, or_assumed
from printctl.pipeline.job.bead_choices import BeadChoices, BeadOptions
from printctl.settings import opt, three_numbers

Place = tuple[float, float, float]


def read_start_position(file: Path, printer: Printer, text: str | None) -> Place:
    """Return the tip's position before the first line, mm.

    The file's first lines may tell it (G92, SET_KINEMATIC_POSITION), and ``text``, of --start.
    Raises `UsageError` when the two aren't the same place, or the file tells a part of it and
    nobody the rest.
    """
    given = None if text is None else three_numbers(text, "--start")
    try:
        job = parse_job(cli.read_gcode_file(file), file.name, printer)
    except LinkError:  # Other checks refuse it.
        return given or (0.0, 0.0, 0.0)
    try:
        declared = declared_start(job)
    except LinkError as exc:
        if given is None:
            raise UsageError(f"{file}: {exc}, or give --start X,Y,Z") from exc
        return given
    if declared is None:
        return given or (0.0, 0.0, 0.0)
    if given is not None and math.dist(given, declared) > ASIDE_MM:
        raise UsageError(
            f"--start {text}: the first lines of {file} tell the printer that the tip stands at "
            f"{','.join(f'{mm:g}' for mm in declared)}; leave --start out, or correct the file"
        )
    return declared


@json_command
def simulate(
    *,
    file: cli.GcodeArg,
    printer: cli.PrinterOption = "generic_marlin",
    syringe: str | None = opt("Syringe profile.", show_default=ASSUMED["syringe"]),
    ink: str | None = opt("Ink profile.", show_default=ASSUMED["ink"]),
    names: ProfileNames,
    start: cli.StartOption = None,
    out: Path | None = opt(
        "Folder for the predicted deposit: tables, timeline, voxels.",
        callback=cli.folder_to_write,
    ),
    bead: BeadOptions,
    place: str | None = opt(
        "Part origin in printer coordinates, mm; default: found from the printed paths.",
        metavar="X,Y,Z",
    ),
) -> None:
    """Run a G-code file through the planner without a printer: time, limits, ink.

    With --out, --lag-s or --network it predicts what will lie in the bath, too. Ends with exit
    code 3 when a check fails; the line and the reason are named.
    """
    have_kernels("simulate")
    profile = load(Printer, printer)
    tip = read_start_position(file, profile, start)
    parts, assumed = or_assumed({"syringe": syringe, "ink": ink})
    mounted = set_up(profile, parts["syringe"], parts["ink"], tip, names)
    gcode = cli.read_gcode_file(file)
    run = dry_run(gcode, profile, tip)
    shaft = file_shaft(file, run, mounted)
    checks = [
        *file_checks(run, mounted, file.with_suffix(".map.npz")),
        *shaft.checks,
        *viability_checks(PrintTime(run.duration_s), shortest_budget(mounted.inks)),
    ]
    at = None if place is None else three_numbers(place, "--place")
    choices = BeadChoices(**vars(bead), out=out, place_mm=at)
    found: list[dict[str, Any]] = []
    predicted: list[str] = []
    notes: list[str] = []
    if choices.asks:
        # What measures and draws the bead takes seconds to load; the dry run needs none of it.
        from printctl.checks.bead import prediction_lines
        from printctl.pipeline.job.predicted_ink import write_predictions

        failures = placed_failures(checks)
        found = write_predictions(file, gcode, run, mounted, choices, failures, cli.print_note)
        for one in found:
            head = f"head {one['head']}: " if len(found) > 1 else ""
            predicted += [head + line for line in prediction_lines(one)]
            for warning in one["warnings"]:
                where = f"line {warning['line']}: " if warning["line"] else ""
                sure = "" if warning["calibrated"] else " (uncalibrated)"
                notes.append(f"{head}{where}{warning['text']}{sure}")
        predicted += [f"wrote {name}" for one in found[:1] for name in one.get("files", [])]
    refusal = refusal_of(checks)
    facts = {
        "file": str(file),
        "printer": profile.name,
        "duration_s": run.duration_s,
        "blocks": len(run.executed),
        "merged_moves": run.merged_moves,
        "passed": not any(check.refuses for check in checks),
        "checks": [check.as_dict() for check in checks],
        **({"predicted": found} if choices.asks else {}),
        **shaft.facts(),
        **(error_facts(refusal, str(refusal), refusal.exit_code) if refusal else {}),
    }
    lines = [
        f"{run.duration_s:.2f} s on {profile.name}, {len(run.executed)} blocks, "
        f"{run.merged_moves} moves merged by the firmware",
        *shaft.lines(),
        *(check.row() for check in checks),
    ]
    cli.print_result(facts, [*lines, *predicted])
    if not wants_json():
        cli.print_notes([*assumed, *warnings(checks), *notes])
    if refusal:
        raise refusal
