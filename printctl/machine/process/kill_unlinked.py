"""Emergency halt of a printer whose print has no link process any more."""

from __future__ import annotations

import os
import threading
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path

from firmware_profiles import Printer, load
from firmware_profiles.families import link_protocol as said
from printctl.machine.control.connecting import protocol_for
from printctl.machine.control.halting import UNCONFIRMED, Kill
from printctl.machine.control.shell import drive
from printctl.machine.control.wiring import Wiring
from printctl.machine.errors import JournalError, LinkError, PortError
from printctl.machine.ports.clock import RealClock
from printctl.machine.ports.transport import open_port
from printctl.machine.process.contact import hold_folder
from printctl.machine.process.outcome import read_outcome
from printctl.machine.records.journal import Journal
from printctl.machine.records.record import JOURNAL, load_record
from printctl.machine.records.replay import read_journal_if_any
from printctl.machine.records.states import LinkState, PrintEnded, Status


def kill_unlinked(folder: Path) -> Status:
    """Open the port of the print in ``folder`` and halt its firmware; write that down as its end.

    Raises
    ------
    LinkError
        When the port can't be used, or the printer doesn't confirm.
    """
    record = load_record(folder)
    printer = load(Printer, record.profile)
    with hold_folder(folder):
        before = read_outcome(folder)
        try:
            transport = open_port(record.port, printer, record.baud)
        except PortError as exc:
            raise LinkError(f"not halted, cut the printer's power: {exc}") from exc
        with closing(transport), closing(_journal(folder)) as journal:
            protocol = protocol_for(printer, transport.quiet_s)
            wiring = Wiring(transport, protocol, RealClock(), journal, printer)
            message = _halt(wiring, read_journal_if_any(folder / JOURNAL).capabilities)
            if UNCONFIRMED in message:
                with suppress(JournalError):
                    journal.add("alarm", text=message)
                raise LinkError(message)
            message += f"; before, the print was {before.state.value}"
            status = replace(
                before, state=LinkState.KILLED, message=message, position_known=False, error=""
            )
            with suppress(JournalError):  # of a full disk: the printer is halted all the same
                journal.add(
                    "end",
                    state=status.state,
                    message=message,
                    done=status.lines_done,
                    error="",
                    position_known=False,
                )
        with suppress(OSError):
            replace(record, address="", token="", status=status.to_dict()).save(folder)
    return status


def _journal(folder: Path) -> Journal:
    """Return the print's journal; a full or damaged disk doesn't keep the halt from going out."""
    try:
        return Journal(folder / JOURNAL)
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
                raise PrintEnded(LinkState.KILLED, f"killed by the user; {started}", known=False)

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
