"""Give up an interrupted print: write its end into the journal."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from firmware_profiles import Printer, ProfileError, load
from printctl.machine.control.gating import settings_changed_by
from printctl.machine.errors import JobError, Refused
from printctl.machine.prints.state import PrintAction, possible_actions
from printctl.machine.process.clients.client import attach
from printctl.machine.process.contact import hold_folder
from printctl.machine.records.actor import actor
from printctl.machine.records.folders import remember_folder
from printctl.machine.records.journal import Journal
from printctl.machine.records.printed_job import load_printed_job
from printctl.machine.records.record import JOURNAL, load_record
from printctl.machine.records.replay import read_journal, read_journal_if_any
from printctl.machine.records.sealing import sign_journal
from printctl.machine.records.states import LinkState, Status

_LIST_LIMIT_S = 5.0
_UNDER_WAY = 32
"""Lines behind the last that is known to be taken, which may have been."""


def give_up(folder: Path, who: str) -> Status:
    """End the record of an interrupted print, as ``who`` says; nothing is sent to the printer.

    Of a network host's print the file is deleted there, where a start of it may still come.

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
    with hold_folder(folder):
        left = _settings_left(folder, status)
        record, history = load_record(folder), read_journal_if_any(folder / JOURNAL)
        if history.unanswered:
            # Network hosts: slow to import, and few prints need it.
            from printctl.machine.network.file_print import void_start
            from printctl.machine.process.host_print import host_of

            left += void_start(lambda: host_of(record), history.unanswered)
        status = replace(
            status,
            state=LinkState.GIVEN_UP,
            message=f"given up by {who}; before: {status.message}{left}",
            position_known=False,
        )
        journal = Journal(folder / JOURNAL, sign=sign_journal)
        journal.add("action", do="give_up", **actor())
        journal.add("end", **status.end_record())
        journal.close()
        closed = replace(record, address="", token="", refused={}, status=status.to_dict())
        closed.save(folder)
    remember_folder(folder).join(_LIST_LIMIT_S)
    return status


def _settings_left(folder: Path, status: Status) -> str:
    """Name what sets the firmware back that the job changed; empty where it changed nothing."""
    record = load_record(folder)
    try:
        printer = load(Printer, record.profile)
        history = read_journal(folder / JOURNAL)
        job = load_printed_job(Path(record.job), printer, history)
    except (JobError, ProfileError):
        return ""
    lines, before = job.lines[: status.lines_done + _UNDER_WAY], history.settings
    commands = [before[code] for code in settings_changed_by(lines, printer) if before.get(code)]
    if not commands:
        return ""
    return f"; settings may be the job's still, send {', '.join(commands)} to have them as before"
