"""Emergency halt of a printer whose print, or station, has no process any more."""

from __future__ import annotations

import os
import threading
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path

from firmware_profiles import Printer, load
from firmware_profiles.families import link_protocol as said
from printctl.machine.control.board.connecting import protocol_for
from printctl.machine.control.board.halting import UNCONFIRMED, Kill
from printctl.machine.control.board.shell import drive
from printctl.machine.control.board.wiring import Wiring
from printctl.machine.control.idle.station_status import NO_PRINTER, StationState
from printctl.machine.control.printing.aftermath import halted_unlinked
from printctl.machine.errors import JournalError, LinkError, NoLink, PortError
from printctl.machine.ports.clock import RealClock
from printctl.machine.ports.detection import SIMULATED, runs_files
from printctl.machine.ports.transport import locate, open_port
from printctl.machine.process.contact import (
    STATION_JOURNAL,
    STATION_LOCK,
    hold_folder,
    last_word,
    load_station,
    records_since,
    save_station,
    without_place,
)
from printctl.machine.process.host_print import halt_on_host
from printctl.machine.process.outcome import read_outcome
from printctl.machine.records.actor import actor
from printctl.machine.records.journal import Journal
from printctl.machine.records.record import JOURNAL, ContactRecord, load_record
from printctl.machine.records.replay import read_journal_if_any
from printctl.machine.records.sealing import sign_journal
from printctl.machine.records.states import LinkState, PrintEnded, Status, state_words


def kill_unlinked(folder: Path) -> Status:
    """Open the port of the print in ``folder`` and halt its firmware; write that down as its end.

    Raises
    ------
    LinkError
        When the port can't be used, or the printer doesn't confirm; `Refused` where a network host
        runs another print.
    """
    record = load_record(folder)
    with hold_folder(folder), closing(_journal(folder / JOURNAL)) as journal:
        before, history = read_outcome(folder), read_journal_if_any(folder / JOURNAL)
        if runs_files(record.port):
            message = halt_on_host(record, before, history)
        else:
            message = _halt_at(record, history.capabilities, journal)
            message += str(halted_unlinked(history.state))
        message += f"; before, the print was {state_words(before.state)}"
        status = replace(
            before, state=LinkState.KILLED, message=message, position_known=False, error=""
        )
        with suppress(JournalError):  # of a full disk: the printer is halted all the same
            journal.add("action", do="kill", **actor())
            journal.add("end", **status.end_record())
        with suppress(OSError):
            replace(record, address="", token="", status=status.to_dict()).save(folder)
    return status


def kill_unlinked_station(folder: Path) -> None:
    """Open the port of the station in ``folder`` and halt its firmware; write that down.

    Raises
    ------
    NoLink
        When it was closed in order, or its printer is a simulated one.
    LinkError
        As `kill_unlinked`.
    """
    with hold_folder(folder, STATION_LOCK, "a printer is connected"):
        record, last = load_station(folder), last_word(folder)
        if last.state is StationState.CLOSED or record.port == SIMULATED:
            raise NoLink(NO_PRINTER)
        path = folder / STATION_JOURNAL
        if last.print_folder and _broke_off(Path(last.print_folder)):
            message = kill_unlinked(Path(last.print_folder)).message
        else:
            told = [one["capabilities"] for one in records_since(path, "firmware", record.started)]
            with closing(_journal(path)) as journal:
                message = _halt_at(record, told[-1] if told else {}, journal)
                with suppress(JournalError):
                    journal.add("state", state=StationState.LOST, message=message)
        message += "; see to the printer, then connect again"
        status = without_place(replace(last, state=StationState.LOST, message=message))
        save_station(replace(record, address="", token="", status=status.to_dict()), folder)


def _broke_off(folder: Path) -> bool:
    """Whether the print in ``folder`` is one whose process ended without a word."""
    try:
        return read_outcome(folder).state is LinkState.INTERRUPTED
    except NoLink:
        return False


def _halt_at(record: ContactRecord, capabilities: dict[str, bool], journal: Journal) -> str:
    """Halt the firmware at a record's port; return what came of it, in words.

    LinkError when the port can't be used, or the printer doesn't confirm.
    """
    printer = load(Printer, record.profile)
    try:
        place = locate(record.port, record.baud, printer)
        transport = open_port(place.port, printer, place.baud)
    except PortError as exc:
        raise LinkError(f"not halted, cut the printer's power: {exc}") from exc
    with closing(transport):
        protocol = protocol_for(printer, transport.quiet_s)
        wiring = Wiring(transport, protocol, RealClock(), journal, printer)
        message = _halt(wiring, capabilities)
    if UNCONFIRMED in message:
        with suppress(JournalError):
            journal.add("alarm", text=message)
        raise LinkError(message)
    return message


def _journal(path: Path) -> Journal:
    """Return the journal there; a full or damaged disk doesn't keep the halt from going out."""
    try:
        return Journal(path, sign=sign_journal)
    except JournalError:
        return Journal(Path(os.devnull))


def _halt(wiring: Wiring, capabilities: dict[str, bool]) -> str:
    """Halt the firmware; return what came of it, in words.

    ``capabilities``: as the firmware has reported them; without, the profile's count.
    """
    kill = Kill(wiring)
    kill.learn(capabilities)

    def hear(data: bytes, now: float) -> None:
        for event in wiring.protocol.feed(data, now):
            if isinstance(event, (said.FirmwareHalted, said.Halting)):
                kill.halted()
                raise PrintEnded(LinkState.KILLED, kill.words(None), known=False)
            if isinstance(event, (said.FirmwareStarted, said.FirmwareReset)):
                kill.halted()
                started = "its board started anew (its port was opened), which drops all it held"
                if kill.pulled_reset:
                    started = "its board started anew by its reset line, which drops all it held"
                raise PrintEnded(
                    LinkState.KILLED, f"emergency stop by the user; {started}", known=False
                )

    striking = threading.Thread(target=kill.strike)
    striking.start()
    try:
        drive(kill.await_halt(hear), wiring)
    except PrintEnded as ended:
        return str(ended)
    finally:
        kill.end()
        striking.join()
    raise AssertionError("await_halt always raises")
