"""`printctl sim-printer`: start the simulated printer as a process for any host."""

from __future__ import annotations

import subprocess
from pathlib import Path

import typer

from printctl.cli.declare import command
from printctl.cli.options import PrinterOption
from printctl.errors import PrintctlError
from printctl.settings import opt
from printctl.sources import python_command


@command
def sim_printer(
    context: typer.Context,
    printer: PrinterOption = "generic_marlin",
    link: Path | None = opt("Name for the pseudo-terminal."),
    tcp: int | None = opt("Listen on this TCP port."),
    speed: float = opt("Times real time; 0 is as fast as it goes.", 1.0, min=0),
) -> None:
    """Run a simulated printer until interrupted; further options are those of `python -m sim`.

    Any host program can print on it: it answers as the profile's firmware does, on a
    pseudo-terminal or a TCP port.
    """
    command = [*python_command("sim"), "--printer", printer, "--speed", str(speed)]
    command += ["--link", str(link)] if link else []
    command += ["--tcp", str(tcp)] if tcp is not None else []
    try:
        done = subprocess.run([*command, *context.args], check=False)
    except KeyboardInterrupt:
        return
    if done.returncode:
        raise PrintctlError("the simulated printer ended with an error; see above")
