"""`printctl recover`: write G-code for the rest of a print whose printer has lost its position."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from printctl.cli.options import (
    JsonFlag,
    messages,
    print_json,
    print_lines,
    refuse_input_as_output,
)
from printctl.cli.run_folder import RunArg, print_folder
from printctl.errors import SafetyError
from printctl.machine.link.record import load_record
from printctl.machine.printing.recovery import planned, write_rest


def recover(
    run: RunArg,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="File for the rest of the job; FILE.rest.gcode by default."),
    ] = None,
    from_line: Annotated[
        int | None,
        typer.Option(
            "--from-line", min=1, help="Line of the job to go on with, in place of the checkpoint."
        ),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Write the file without asking.")] = False,
    as_json: JsonFlag = False,
) -> None:
    """Plan how to go on after a power cut or a reset, from the last checkpoint.

    Tells what has to be done by hand, and writes the rest of the job as a file that comes to the
    point from above. Nothing is sent to the printer.
    """
    folder = print_folder(run)
    plan = planned(folder, from_line)
    job = Path(load_record(folder).job)
    refuse_input_as_output(out, job)
    file = out or job.with_suffix(".rest.gcode")
    messages().print(
        *(f"{k}. {text}" for k, text in enumerate(plan.steps, 1)), sep="\n", markup=False
    )
    _confirm(file, yes)
    written = write_rest(folder, plan, file)
    if as_json:
        print_json(written)
        return
    print_lines(str(file), f"when all that is done: {written['command']}")


def _confirm(file: Path, assume_yes: bool) -> None:
    if assume_yes:
        return
    answer = ""
    if sys.stdin.isatty():
        messages().print(f"Write {file}? Type yes: ", end="")
        answer = sys.stdin.readline()
    if answer.strip().lower() != "yes":
        raise SafetyError(f"{file} wasn't written; answer yes, or give --yes")
