"""`printctl resume`: go on with a print that is paused, or whose link process died."""

from __future__ import annotations

from typing import Annotated, Final

import typer

from firmware_profiles import Printer, Syringe, load
from printctl.cli.options import print_lines
from printctl.cli.run_folder import RunArg, print_folder
from printctl.errors import PrintctlError, UsageError
from printctl.link.care import Care, NewSyringe
from printctl.link.client import attach, resume_print
from printctl.link.states import LinkState, Status
from printctl.printing import usable_mm

_GOING_ON: Final = (LinkState.CONNECTING, LinkState.CHECKING, LinkState.PRINTING)


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
) -> None:
    """Go on: come down where the print was left, prime, verify the position, print.

    After the link process died or lost its port, the printer is asked for its last line first.
    """
    folder = print_folder(run)
    told = syringe is not None or plunger_mm is not None
    if unchanged and told:
        raise UsageError("--unchanged excludes --syringe and --plunger-mm")
    with attach(folder) as found:
        record, status = found.record, found.status
    ended = status.ended
    if status.state in _GOING_ON and not status.waits_for and not (told or unchanged):
        raise PrintctlError(
            f"the print in {folder} isn't paused ({status.state.value}: {status.message})"
        )
    with resume_print(folder, port) if ended else attach(folder) as client:
        if ended and client.status.state is not LinkState.PAUSED:
            print_lines("going on from the printer's last line")
            return
        change = None
        if told:
            care, head = Care.from_dict(record.care), changed_head(client.status)
            change = new_syringe(care, record.profile, syringe, plunger_mm or 0.0, head)
        client.resume(change, unchanged)
        print_lines(f"going on; `printctl status {run}` tells how")


def changed_head(status: Status) -> int | None:
    """Of several heads, whose syringe the print waits for."""
    what, _, number = status.waits_for.partition(" ")
    return int(number) if what == "syringe" and number else None


def new_syringe(
    care: Care, printer: str, name: str | None, plunger_mm: float, head: int | None = None
) -> NewSyringe:
    """What was put in; the job's plunger travel holds for one bore only.

    Parameters
    ----------
    care : Care
        Names the syringe in use so far.
    printer : str
        Profile: how far its drive goes.
    name : str or None
        Profile of the new one; None for one like the last.
    plunger_mm : float, mm
    head : int, optional
        Of several, whose.

    Raises
    ------
    UsageError
        When its bore isn't the last one's.
    """
    if name is None:
        return NewSyringe(plunger_mm)
    new = load(Syringe, name)
    before, _ = care.of_head(head)
    if before:
        old = load(Syringe, before)
        if new.inner_mm != old.inner_mm:
            raise UsageError(
                f"{new.name} has a bore of {new.inner_mm:g} mm, {old.name} of {old.inner_mm:g} mm: "
                "the job's plunger travel would give another volume; put in one of the same bore"
            )
    machine = load(Printer, printer)
    return NewSyringe(plunger_mm, name, usable_mm(new, machine.of_head(head or 0)))
