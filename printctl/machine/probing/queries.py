"""Open a printer's port, ask the firmware for its settings, and close it.

The port is opened as a link process opens it, alone: while a print holds it, it is in use. Nothing
is sent but the handshake and questions. On boards that reset when the port opens, it resets them.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from firmware_profiles import Printer
from firmware_profiles.families import family_of
from printctl.machine.control.channel import Channel
from printctl.machine.control.connecting import connect
from printctl.machine.control.logbook import Logbook
from printctl.machine.control.print_events import print_channel
from printctl.machine.control.progress import JobProgress
from printctl.machine.control.protocols import protocol_for
from printctl.machine.control.requests import RequestQueue
from printctl.machine.control.wiring import Wiring
from printctl.machine.errors import LinkError
from printctl.machine.families import refuse_unsent
from printctl.machine.job.job import Job
from printctl.machine.ports.clock import RealClock
from printctl.machine.ports.detection import named_port
from printctl.machine.ports.transport import open_port
from printctl.machine.probing.settings import Settings, read_settings
from printctl.machine.records.journal import Journal
from printctl.machine.records.states import PrintEnded

_TRIES = 3


def _answers(wiring: Wiring, questions: Sequence[bytes]) -> dict[bytes, Sequence[bytes]]:
    """Return what the printer says to each question.

    Raises
    ------
    LinkError
        When nobody answers, or the printer halts.
    """
    logbook = Logbook(wiring, JobProgress(wiring, Job([], [], "", "questions")))
    channel, _ = print_channel(wiring, logbook, RequestQueue())
    try:
        connect(channel)
        return {question: _answer(channel, question) for question in questions}
    except PrintEnded as ended:
        raise LinkError(f"the printer couldn't be asked: {ended.message}") from ended


def _answer(channel: Channel, question: bytes) -> tuple[bytes, ...]:
    for _ in range(_TRIES):
        replies = channel.ask(question)
        if replies:
            return replies
    return ()


def query_transport(wiring: Wiring) -> Settings:
    """Ask over a wire that is open already."""
    family = family_of(wiring.printer)
    return read_settings(family, _answers(wiring, family.setting_questions))


def query_settings(port: str, printer: Printer, baud: int | None = None) -> Settings:
    """Open the port, ask for the printer's settings, and close it.

    Parameters
    ----------
    port : str
        Or ``auto``.
    printer : Printer
        Profile, for the firmware's family and the baud rate.
    baud : int, optional
        In place of the profile's.

    Raises
    ------
    LinkError
        `PortInUse` while a print or another program holds the port; `Refused` for a printer that
        takes no lines from a host; or nobody answers.
    """
    refuse_unsent(printer)
    transport = open_port(named_port(port, printer), printer, baud)
    try:
        with tempfile.TemporaryDirectory() as folder:
            journal = Journal(Path(folder) / "journal.log")
            try:
                wiring = Wiring(
                    transport=transport,
                    protocol=protocol_for(printer, transport.quiet_s),
                    clock=RealClock(),
                    journal=journal,
                    printer=printer,
                )
                return query_transport(wiring)
            finally:
                journal.close()
    finally:
        transport.close()
