"""`printctl recover`: go on with a print whose printer has lost its position."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from design.files import write_bytes
from firmware_profiles import Printer, load
from printctl.cli.options import JsonFlag, messages, print_json, print_lines, read_gcode_file
from printctl.cli.run_folder import RunArg, print_folder
from printctl.errors import PrintctlError, SafetyError
from printctl.link.errors import LinkError
from printctl.link.job import parse_job
from printctl.link.journal import read_journal
from printctl.link.reach import stays_alive
from printctl.link.record import JOURNAL, load_record
from printctl.link.recovering import Recovery, plan_recovery
from printctl.link.retreat import Retreat
from printctl.link.states import LinkState


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
    record = load_record(folder)
    if stays_alive(folder):
        raise PrintctlError(f"the print in {folder} is going on; there is nothing to recover")
    plan = _planned(folder, from_line)
    file = out or Path(record.job).with_suffix(".rest.gcode")
    messages().print(
        *(f"{k}. {text}" for k, text in enumerate(plan.steps, 1)), sep="\n", markup=False
    )
    _confirm(file, yes)
    write_bytes(file, plan.gcode)
    start = ",".join(f"{value:g}" for value in plan.start) if plan.start else None
    then = f"printctl print {file} --printer {record.profile} --port {record.port}"
    then += f" --start {start}" if start else ""
    if as_json:
        print_json({"file": str(file), "steps": plan.steps, "lines_left_out": plan.begin})
        return
    print_lines(str(file), f"when all that is done: {then}")


def _planned(folder: Path, from_line: int | None) -> Recovery:
    record = load_record(folder)
    history = read_journal(folder / JOURNAL)
    data = read_gcode_file(Path(record.job))
    printer = load(Printer, record.profile)
    job = parse_job(data, Path(record.job).name, printer)
    if history.job.get("sha256") != job.sha256:
        raise PrintctlError(
            f"{record.job} has changed since it was printed in {folder}; put the file back that "
            "was printed (its hash is in the journal)"
        )
    if history.end is not None and history.end.get("state") == LinkState.DONE:
        raise PrintctlError(f"the print in {folder} was done; there is nothing to recover")
    retreat = Retreat(**record.retreat)
    try:
        return plan_recovery(job, data, history, printer, retreat, from_line)
    except LinkError as exc:  # nothing was sent, so it isn't the printer that failed
        raise PrintctlError(str(exc)) from exc


def _confirm(file: Path, assume_yes: bool) -> None:
    if assume_yes:
        return
    answer = ""
    if sys.stdin.isatty():
        messages().print(f"Write {file}? Type yes: ", end="")
        answer = sys.stdin.readline()
    if answer.strip().lower() != "yes":
        raise SafetyError(f"{file} wasn't written; answer yes, or give --yes")
