"""`printctl resume`: resume a print that is paused, or whose link process died."""

from __future__ import annotations

from typing import Annotated

import typer

from printctl.cli.observe_looks import asking_lines
from printctl.cli.options import print_lines
from printctl.cli.run_folder import RunArg, print_folder
from printctl.errors import UsageError
from printctl.machine.link.client import attach
from printctl.machine.link.errors import LinkError
from printctl.machine.link.find_link import alive
from printctl.machine.link.states import LinkState
from printctl.observe.continue_print import continue_print
from printctl.observe.records import OBSERVER_LOCK


def resume(
    run: RunArg,
    syringe: Annotated[
        str | None,
        typer.Option("--syringe", help="Profile of the syringe that was put in."),
    ] = None,
    plunger_mm: Annotated[
        float | None,
        typer.Option(
            "--plunger-mm",
            min=0.0,
            help="Travel that its plunger has used up already; 0 for a full one.",
        ),
    ] = None,
    unchanged: Annotated[
        bool, typer.Option("--unchanged", help="The syringe wasn't changed after all.")
    ] = False,
    port: Annotated[
        str | None, typer.Option("--port", help="When the printer's port has another name now.")
    ] = None,
    unobserved: Annotated[
        bool,
        typer.Option(
            "--unobserved",
            help="Start no observer for a print with looks: each look pauses it after its limit.",
        ),
    ] = False,
) -> None:
    """Go on: come down where the print was left, prime, verify the position, print.

    After the link process died or lost its port, the printer is asked for its last line first. An
    observed print whose observer is gone gets another one first.
    """
    if unchanged and (syringe is not None or plunger_mm is not None):
        raise UsageError("--unchanged excludes --syringe and --plunger-mm")
    folder = print_folder(run)
    with attach(folder) as attached:
        ended = attached.status.ended
    unheard = not (unobserved or alive(folder, OBSERVER_LOCK))
    status = continue_print(
        folder,
        port=port,
        syringe=syringe,
        plunger_mm=plunger_mm,
        unchanged=unchanged,
        unobserved=unobserved,
    )
    if status.ended and status.state is not LinkState.DONE:
        raise LinkError(f"not gone on with: {status.message}")
    if unheard and (asking := asking_lines(folder, status)):
        print_lines(
            "another observer is at work, and the print stays paused for an answer", *asking
        )
        return
    where = "from the printer's last line" if ended else f"`printctl status {run}` tells how"
    print_lines(f"going on; {where}")
