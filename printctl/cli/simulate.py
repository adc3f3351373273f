"""`printctl simulate`: the dry run of any G-code file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from firmware_profiles import Printer, Syringe, load
from printctl.cli.options import (
    JsonFlag,
    PrinterOption,
    StartOption,
    SyringeOption,
    print_json,
    print_lines,
    read_gcode_file,
    three_numbers,
)
from printctl.preflight import gcode_checks, refuse_failed, syringe_check
from sim.dryrun import dry_run


def simulate(
    file: Annotated[Path, typer.Argument(help="The G-code file.", show_default=False)],
    printer: PrinterOption = "generic_marlin",
    syringe: SyringeOption = "hamilton_1ml",
    start: StartOption = "0,0,0",
    as_json: JsonFlag = False,
) -> None:
    """Run a G-code file through the planner without a printer: time, limits, ink.

    Ends with exit code 3 when a check fails; the line and the reason are named.
    """
    profile, filled = load(Printer, printer), load(Syringe, syringe)
    run = dry_run(read_gcode_file(file), profile, three_numbers(start, "--start"))
    checks = [*gcode_checks(run, profile), syringe_check(run, filled)]
    if as_json:
        print_json(
            {
                "file": str(file),
                "printer": profile.name,
                "duration_s": run.duration_s,
                "blocks": len(run.executed),
                "merged_moves": run.merged_moves,
                "passed": all(check.passed for check in checks),
                "checks": [check.as_dict() for check in checks],
            }
        )
    else:
        print_lines(
            f"{run.duration_s:.2f} s on {profile.name}, {len(run.executed)} blocks, "
            f"{run.merged_moves} moves merged by the firmware",
            *(check.row() for check in checks),
        )
    refuse_failed(checks)
