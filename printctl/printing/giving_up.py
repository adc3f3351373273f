"""Give up an interrupted print: write its end into the journal."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from printctl.link.client import attach
from printctl.link.errors import Refused
from printctl.link.history import remember_meanwhile
from printctl.link.journal import Journal
from printctl.link.process import only_one
from printctl.link.record import JOURNAL, load_record
from printctl.link.states import LinkState, Status
from printctl.printing.print_actions import PrintAction, possible_actions

_PATIENCE_S = 5.0


def give_up(folder: Path, who: str) -> Status:
    """End the record of an interrupted print; nothing is sent to the printer.

    Parameters
    ----------
    folder : Path
        The print's.
    who : str
        Who says so.

    Raises
    ------
    Refused
        When the print goes on, or its end is written down already.
    AlreadyPrinting
        When a link process has just begun there.
    JournalError
        When the end can't be written.
    """
    with attach(folder) as client:
        status = client.status
    can = next(one for one in possible_actions(folder, status) if one.action is PrintAction.GIVE_UP)
    if not can.possible:
        raise Refused(f"the print in {folder} isn't given up: {can.reason}")
    with only_one(folder):
        status = replace(
            status,
            state=LinkState.GIVEN_UP,
            message=f"given up by {who}; before: {status.message}",
            position_known=False,
        )
        journal = Journal(folder / JOURNAL)
        journal.add(
            "end",
            state=status.state,
            message=status.message,
            done=status.lines_done,
            error=status.error,
            position_known=False,
        )
        journal.close()
        replace(load_record(folder), address="", token="", status=status.to_dict()).save(folder)
    remember_meanwhile(folder).join(_PATIENCE_S)
    return status
