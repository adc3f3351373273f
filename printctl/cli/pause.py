"""`printctl pause`: pause a print now, or after the present layer or vessel."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from printctl.cli.options import print_lines
from printctl.cli.run_folder import RunArg, running_print
from printctl.errors import UsageError
from printctl.machine.link.marks import MarkKind
from printctl.machine.link.states import LinkState


class PauseAfter(StrEnum):
    """What is to be finished first."""

    LAYER = "layer"
    VESSEL = "vessel"


def pause(
    run: RunArg,
    after: Annotated[
        PauseAfter | None,
        typer.Option("--after", help="Finish the current layer or vessel first."),
    ] = None,
    now: Annotated[
        bool, typer.Option("--now", help="After the line in flight; the default.")
    ] = False,
) -> None:
    """Hold a print: relieve the plunger, lift the needle straight up, keep the temperatures.

    `printctl resume RUN` comes back to the same point and goes on.
    """
    if now and after:
        raise UsageError("--now and --after exclude each other; give one")
    with running_print(run) as client:
        if client.status.state is LinkState.PAUSED:
            print_lines(f"is paused already; `printctl resume {run}` goes on")
            return
        client.pause(MarkKind(after.value) if after else None)
        held = "after the line in flight and the moves that the printer holds"
        where = f"at the end of this {after.value}" if after else held
        print_lines(f"will pause {where}; `printctl status {run}` tells when")
