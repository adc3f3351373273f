"""`printctl print`: send a G-code file to a printer."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from firmware_profiles import Ink, Printer, Syringe, load
from printctl.cli.options import (
    JsonFlag,
    PrinterOption,
    StartOption,
    SyringeOption,
    YesFlag,
    messages,
    print_json,
    print_lines,
    read_gcode_file,
    three_numbers,
)
from printctl.preflight import gcode_checks, refuse_failed, syringe_check
from printctl.printing import (
    SIMULATED,
    Order,
    confirm,
    find_or_start,
    follow,
    retreat_for,
    running,
    simulated_printer,
)
from printctl.progress import StageBars
from sim.dryrun import dry_run


def print_job(
    file: Annotated[Path, typer.Argument(help="The G-code file.", show_default=False)],
    printer: PrinterOption,
    port: Annotated[
        str,
        typer.Option(
            "--port", help="Serial port, tcp:HOST:PORT, or simulated.", show_default=False
        ),
    ],
    syringe: SyringeOption = "hamilton_1ml",
    ink: Annotated[str, typer.Option("--ink", help="Ink profile.")] = "collagen_fresh",
    start: StartOption = "0,0,0",
    folder: Annotated[
        Path | None,
        typer.Option("--folder", help="For the journal; FILE.print by default."),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with an interrupted print of this file.")
    ] = False,
    yes: YesFlag = False,
    as_json: JsonFlag = False,
) -> None:
    """Check a G-code file and print it; attach when its print is already going on.

    The print runs in a process of its own and goes on when this command ends. Ctrl-C asks: detach,
    stop or kill.
    """
    profile, filled = load(Printer, printer), load(Syringe, syringe)
    place = folder if folder is not None else file.with_name(file.name + ".print")
    tip = three_numbers(start, "--start")
    retreat = retreat_for(filled, load(Ink, ink), lift_mm=20.0)
    order = Order(file, printer, port, place, retreat, resume)
    if running(order) is None:
        run = dry_run(read_gcode_file(file), profile, tip)
        refuse_failed([*gcode_checks(run, profile), syringe_check(run, filled)])
    place.mkdir(parents=True, exist_ok=True)

    def open_port() -> str:
        if port != SIMULATED:
            confirm(port, bars, yes)
            return port
        return simulated_printer(printer, tip, place / "executed.npz", place)

    bars = StageBars(messages())
    with bars.all(), bars.stage("print") as report:
        outcome = follow(find_or_start(order, open_port), report, bars)
    if as_json:
        print_json(
            {"state": outcome.state.value, "lines": outcome.lines_done, "folder": str(place)}
        )
        return
    print_lines(f"{outcome.state.value}: {outcome.message}", str(place))
