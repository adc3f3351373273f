"""`printctl simulate`: dry-run and check a G-code file; optionally predict the ink in the bath."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from firmware_profiles import Printer, load
from printctl.checks.set_up import (
    ASSUMED,
    ProfileNames,
    or_assumed,
    placed_failures,
    set_up,
    warnings,
)
from printctl.cli import options as cli
from printctl.cli.declare import json_command, wants_json
from printctl.cli.kernels_ready import have_kernels
from printctl.failures import error_facts
from printctl.pipeline.checked_order import OrderCare, care_part, checked_order, told_start
from printctl.pipeline.job.bead_choices import BeadChoices, BeadOptions
from printctl.recipe.sections.making import CarePart
from printctl.settings import of, opt, settings, three_numbers

Place = tuple[float, float, float]


@settings
class CheckOptions:
    """What the checks of a job take for granted, as the command line says it."""

    reload: bool = of(CarePart, "reload")
    reload_min: float | None = of(CarePart, "reload_min", "--reload-min", metavar="MINUTES")
    viability_min: float | None = opt(
        "How long the print may take for its cells' sake, changes of syringe included; the ink's "
        "own by default.",
        metavar="MINUTES",
    )
    viability_source: str | None = of(CarePart, "viability_source", metavar="TEXT")
    accept_crossings: bool = opt(
        "Print although the needle shaft crosses printed vessels; recorded in the journal.",
        False,
    )

    def values(self) -> dict[str, Any]:
        """As `CarePart` takes them."""
        return {name: v for name, v in vars(self).items() if name != "accept_crossings"}


def read_start_position(file: Path, printer: Printer, text: str | None) -> Place | None:
    """Return the tip's position before the first line, mm: ``text``, of --start, or the file's own.

    None where neither tells it; `printctl.pipeline.checked_order` refuses a file that tells a part
    of it.
    """
    gcode = cli.read_gcode_file(file)
    if text is not None:
        return three_numbers(text, "--start")
    return told_start(gcode, file.name, printer)


@json_command
def simulate(
    *,
    file: cli.GcodeArg,
    printer: cli.PrinterOption = "generic_marlin",
    syringe: str | None = opt("Syringe profile.", show_default=ASSUMED["syringe"]),
    ink: str | None = opt("Ink profile.", show_default=ASSUMED["ink"]),
    names: ProfileNames,
    start: cli.StartOption = None,
    limits: CheckOptions,
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
    care = OrderCare(care_part(**limits.values()), accept_crossings=limits.accept_crossings)
    checked = checked_order(file, mounted, care)
    run, shaft, checks = checked.run, checked.shaft, checked.checks
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
    refusal = checked.refusal
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
