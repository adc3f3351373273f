"""Client of a print's link process: start a print, attach to it, follow it, stop it.

A client may go away at any time; the print doesn't mind.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final, Self

from firmware_profiles import Printer, load
from printctl.machine.errors import BY_NAME, AlreadyPrinting, LinkError, NoLink, Refused
from printctl.machine.job.care import Care, NewSyringe
from printctl.machine.job.job import load_job
from printctl.machine.job.marks import MarkKind
from printctl.machine.job.retreat import Retreat
from printctl.machine.ports.detection import AUTO
from printctl.machine.ports.transport import locate
from printctl.machine.process.connection import ANSWER_LIMIT_S, Connection
from printctl.machine.process.detached_process import START_LIMIT_S, spawn
from printctl.machine.process.find_link import has_ended, read_outcome, stays_alive
from printctl.machine.process.look_client import LookClient
from printctl.machine.process.resuming import resumable
from printctl.machine.records.record import LOG, LinkRecord, load_record
from printctl.machine.records.states import EARLY, PrintOutcome, Status
from printctl.sources import python_command

_PATIENCE_S: Final = 60.0
"""For an answer to a request that waits for the line in flight: a manual command, a resume."""


class PrintClient:
    """One client of one print; made by `start_print` or `attach`.

    It lets go of its connection when it has heard of the end, on `detach`, and at the end of a
    ``with`` block; the print goes on.

    Parameters
    ----------
    folder : Path
    record : LinkRecord
    """

    def __init__(self, folder: Path, record: LinkRecord) -> None:
        self.folder = folder
        self._connection = Connection(folder, record)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *problem: object) -> None:
        self.detach()

    @property
    def record(self) -> LinkRecord:
        """What the link process told of itself."""
        return self._connection.record

    def detach(self) -> None:
        """Leave; the print goes on."""
        self._connection.detach()

    # --- what a client may ask for ---------------------------------------------------------

    def stop(self) -> None:
        """Ask for a controlled stop: end the line in flight, relieve the plunger, lift."""
        self._connection.send("stop")

    def kill(self) -> None:
        """Halt the firmware at once; afterwards the position is unknown."""
        self._connection.send("kill")

    def pause(self, after: MarkKind | None = None) -> None:
        """Ask for a pause: relieve the plunger, lift, hold.

        Parameters
        ----------
        after : MarkKind, optional
            Once a layer or vessel has ended; now without.

        Raises
        ------
        Refused
            When the job marks no such end ahead.
        """
        self._connection.ask("pause", after=after)

    def reload(self, head: int | None = None) -> None:
        """Ask for a change of syringe: at the next reload point, or here when it is paused.

        Of several heads that of ``head``; else of the one in use.

        Raises
        ------
        Refused
            When the job marks no reload point ahead.
        """
        self._connection.ask("reload", head=head)

    def resume(
        self,
        change: NewSyringe | None = None,
        unchanged: bool = False,
        unobserved: bool = False,
    ) -> None:
        """Go on after a pause; `PrintRequests.resume` says what may be told.

        Returns once the print goes on, or has ended.

        Raises
        ------
        Refused
            When it stays paused, with the reason.
        LinkError
            When it hasn't gone on within 60 s.
        """
        told = asdict(change) if change else None
        self._connection.send("resume", change=told, unchanged=unchanged, unobserved=unobserved)
        for message in self._connection.messages(_PATIENCE_S):
            self._connection.take(message)
            if message["event"] == "refused":
                raise Refused(message["message"])
            if message["event"] == "resumed":
                return
        if self._connection.reach():
            raise LinkError(
                f"the print in {self.folder} hasn't said within {_PATIENCE_S:g} s whether it goes "
                "on; `printctl status RUN` tells"
            )

    def alive(self) -> None:
        """Confirm that somebody is there: the dead-man's time begins anew."""
        self._connection.ask("alive")

    def command(self, text: str) -> list[str]:
        """Send a manual command between two lines of the job; give the printer's reply.

        Raises
        ------
        Refused
            When the link refuses it.
        LinkError
            When the print ends first.
        """
        self._connection.send("command", text=text)
        for message in self._connection.messages(_PATIENCE_S):
            self._connection.take(message)
            if message["event"] == "reply" and message["command"] == text.strip():
                return list(message["lines"])
            if message["event"] == "refused":
                raise Refused(message["message"])
        raise LinkError(f"no reply to {text!r} within {_PATIENCE_S:g} s, or the print ended first")

    @property
    def looks(self) -> LookClient:
        """What may be said of a look that the print is held for."""
        return LookClient(self._connection)

    # --- what a client may hear ------------------------------------------------------------

    @property
    def status(self) -> Status:
        """The print as it is now; asks the link process.

        Raises
        ------
        NoLink
            When a link process is alive but doesn't answer.
        """
        connection = self._connection
        if connection.last is not None and connection.last.ended:
            return connection.last
        connection.send("status")
        for message in connection.messages(ANSWER_LIMIT_S):
            status = self._take(message)
            if status is not None and (message.get("asked") or status.ended):
                return status
        if connection.reach():
            raise NoLink(f"the link process of {self.folder} doesn't answer; see {LOG}")
        return connection.keep(read_outcome(self.folder))

    def events(self) -> Iterator[Status]:
        """Give the status as it is known, if it is, then each as it comes; the last one has ended.

        What `start_print` took last is given again, and what came while another call waited for
        its answer: a print may stand still in it, as in a look, until somebody decides.
        """
        connection, told = self._connection, None
        while True:
            while connection.last is not None and connection.last is not told:
                told = connection.last
                yield told
                if told.ended:
                    connection.detach()
                    return
            if not connection.reach():
                yield connection.keep(read_outcome(self.folder))
                return
            for message in connection.messages(None):
                if self._take(message) is not None:
                    break

    def _take(self, message: dict[str, Any]) -> Status | None:
        """Return the status that a message tells; let go of the connection at the end."""
        status = self._connection.take(message)
        if status is not None and status.ended:
            self._connection.detach()
        return status

    def wait(self, timeout: float | None = None) -> PrintOutcome:
        """Wait for the end of the print.

        Raises
        ------
        TimeoutError
            When it isn't over after ``timeout`` s.
        """
        connection, last = self._connection, self._connection.last
        limit = math.inf if timeout is None else time.monotonic() + timeout
        while last is None or not last.ended:
            if not connection.reach():
                last = connection.keep(read_outcome(self.folder))
                break
            left = None if timeout is None else limit - time.monotonic()
            for message in connection.messages(left):
                last = self._take(message) or last
                if last is not None and last.ended:
                    break
            else:
                if time.monotonic() >= limit:
                    raise TimeoutError(f"the print in {self.folder} isn't over after {timeout} s")
        connection.detach()
        return PrintOutcome.of(last)


def start_print(
    job: Path,
    printer: str,
    port: str,
    folder: Path,
    *,
    retreat: Retreat | None = None,
    baud: int | str | None = None,
    care: Care | None = None,
    resume: bool = False,
) -> PrintClient:
    """Start a link process for a job, and attach to it.

    Returns once the printer has answered the handshake and the first lines go out.

    Parameters
    ----------
    job : Path
        G-code file.
    printer : str
        Profile, by name or path.
    port : str
        Device, ``tcp:HOST:PORT``, ``socket://HOST:PORT``, or ``auto``: the one with the profile's
        USB id.
    folder : Path
        Where the journal and the record of the print go.
    retreat : Retreat, optional
        How the needle leaves the bath in a controlled stop or a pause.
    baud : int or "auto", optional
        In place of the profile's; ``auto`` tries the profile's list.
    care : Care, optional
        How the print is watched over.
    resume : bool
        Go on with the print whose link process died in ``folder``.

    Raises
    ------
    AlreadyPrinting
        When a link process is alive in ``folder``.
    LinkError
        When the print fails before its first line: port missing, denied or in use, no answer to
        the handshake, a job with a line that must not be sent.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if stays_alive(folder):
        raise AlreadyPrinting(
            f"a print is running in {folder}; attach to it, or give another folder"
        )
    done = 0
    if resume:
        done = resumable(folder, load_job(job, load(Printer, printer)).sha256).done
    if AUTO in (port, baud):
        place = locate(port, baud, load(Printer, printer))
        port, baud = place.port, place.baud
    command = [
        *python_command("printctl.machine.process"),
        str(job.resolve()),
        "--printer",
        printer,
    ]
    command += ["--port", port, "--folder", str(folder.resolve()), "--detach"]
    command += ["--retreat", json.dumps(asdict(retreat or Retreat()))]
    command += ["--care", json.dumps((care or Care()).to_dict())]
    command += ["--baud", str(baud)] if baud else []
    command += ["--resume"] if resume else []
    return wait_for_first_lines(_await_link(spawn(command), folder), done)


def wait_for_first_lines(client: PrintClient, done: int = 0) -> PrintClient:
    """Wait until the first lines of a print go out.

    Parameters
    ----------
    client : PrintClient
    done : int
        Lines that were taken before it was gone on with.

    Raises
    ------
    LinkError
        When it fails before.
    """
    for status in client.events():
        if status.state not in EARLY:
            break
    status = client.status
    if status.ended and status.lines_done == done and status.error:
        raise _error(status.error, status.message)
    return client


def resume_print(folder: Path, port: str | None = None) -> PrintClient:
    """Go on with the print in ``folder``, whose link process died or lost its port.

    The printer is asked for its last line. If it was reset, or its position isn't the job's, the
    print ends as ``position_unknown`` without a move.

    Parameters
    ----------
    folder : Path
    port : str, optional
        When the printer's port has another name now.

    Raises
    ------
    Refused
        When the print has ended in another way, or never began.
    LinkError
        When there is no such print, it is running, or the port can't be used.
    """
    record = load_record(folder)
    return start_print(
        Path(record.job),
        record.profile,
        port or record.port,
        folder,
        retreat=Retreat(**record.retreat),
        baud=record.baud,
        care=Care.from_dict(record.care),
        resume=True,
    )


def attach(folder: Path) -> PrintClient:
    """Attach to the print in ``folder``; if it is over, its client tells how it ended.

    Raises
    ------
    NoLink
        When no print was ever started there.
    """
    return PrintClient(folder, load_record(folder))


def _await_link(pid: int, folder: Path) -> PrintClient:
    """Wait until the process listens, or has ended."""
    limit = time.monotonic() + START_LIMIT_S
    while time.monotonic() < limit:
        over = has_ended(pid)
        record = _record_in(folder)
        if record is not None and record.refused.get("pid") == pid:
            raise _error(record.refused["error"], record.refused["message"])
        if record is not None and record.pid == pid and (record.address or record.status):
            return PrintClient(folder, record)
        if over:
            said = (folder / LOG).read_text(encoding="utf-8", errors="replace").splitlines()
            raise LinkError(f"the link process ended at once: {said[-1] if said else 'no word'}")
        time.sleep(0.02)
    raise NoLink(f"the link process didn't come up within {START_LIMIT_S:g} s; see {folder / LOG}")


def _record_in(folder: Path) -> LinkRecord | None:
    try:
        return load_record(folder)
    except NoLink:
        return None


def _error(name: str, message: str) -> LinkError:
    return BY_NAME.get(name, LinkError)(message)
