"""Run one print in a separate process, the only owner of the printer's port and the journal.

It is started detached (a session of its own), ignores Ctrl-C and hang-ups, and goes on when the
program that started it dies. It ends by itself when the print is over and the end is recorded in
the journal and in ``link.json``.
"""

from __future__ import annotations

import logging
import math
import os
import secrets
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Final

from firmware_profiles import Printer, ProfileError, load
from printctl.checks.gate import PrinterSituation
from printctl.machine.control.parking import refuse_park
from printctl.machine.control.protocols import protocol_for
from printctl.machine.control.streamer import Streamer
from printctl.machine.control.wiring import Wiring
from printctl.machine.errors import AlreadyPrinting, JournalError, LinkError, NoLink
from printctl.machine.families import refuse_unsent
from printctl.machine.job.care import Care
from printctl.machine.job.job import load_job
from printctl.machine.job.retreat import Retreat
from printctl.machine.ports.clock import RealClock
from printctl.machine.ports.locking import lock
from printctl.machine.ports.transport import Transport, open_port
from printctl.machine.ports.wire_log import FILE, LoggedTransport, WireLog
from printctl.machine.process.resuming import resumable
from printctl.machine.process.server import Server, forget, listen
from printctl.machine.records.folders import archive_journal, remember_folder
from printctl.machine.records.journal import Journal, new_print_id, origin, this_user
from printctl.machine.records.record import JOURNAL, LOCK, LinkRecord, load_record
from printctl.machine.records.replay import read_journal
from printctl.machine.records.states import LinkState, Status

_LOCK_PATIENCE_S: Final = 0.3

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Order:
    """What the link process is told to do.

    Attributes
    ----------
    job : Path
        G-code file.
    profile : str
        Printer profile, by name or path.
    port : str
    folder : Path
        Where journal, socket and record go.
    baud : int or None
        In place of the profile's.
    retreat : Retreat
    care : Care
    resume : bool
        Go on with the folder's journal, whose link process died.
    """

    job: Path
    profile: str
    port: str
    folder: Path
    baud: int | None = None
    retreat: Retreat = field(default_factory=Retreat)
    care: Care = field(default_factory=Care)
    resume: bool = False


@dataclass(frozen=True)
class Wire:
    """A port that is open already, and stays so after the print.

    Attributes
    ----------
    transport : Transport
    on_start : callable
        Given the print's streamer once its clients can reach it.
    on_status : callable
        Told what the print's clients are told.
    fresh : bool
        Whether it has just been opened, so that the board may be starting.
    room : callable or None
        What is known of the room around the tip, for what a person types into the print.
    """

    transport: Transport
    on_start: Callable[[Streamer], None]
    on_status: Callable[[Status], None]
    fresh: bool = False
    room: Callable[[], PrinterSituation] | None = None


def serve(order: Order, wire: Wire | None = None) -> Status:
    """Run the link process in this process, to the end of the print.

    Parameters
    ----------
    order : Order
    wire : Wire, optional
        An open port to print on; else the order's is opened, and closed at the end.

    Returns
    -------
    Status
        The last one; it is in the folder's ``link.json``, too.
    """
    order.folder.mkdir(parents=True, exist_ok=True)
    with hold_folder(order.folder):
        ignore_signals()
        contact = _Contact(order)
        try:
            status = _print(order, contact, wire)
        except (LinkError, ProfileError) as exc:
            log.error("%s", exc)
            status = Status(LinkState.FAILED, message=str(exc), error=type(exc).__name__)
        except Exception as exc:
            log.exception("the link process met an error of its own")
            status = Status(
                LinkState.FAILED,
                message=f"the link process failed: {exc!r}; see link.log",
                error="LinkError",
                position_known=False,
            )
            raise
        finally:
            contact.end(status)
    return status


class _Contact:
    """The folder's ``link.json``.

    An unfinished print's stays where an attempt ends before it writes to the journal.

    Parameters
    ----------
    order : Order
    """

    def __init__(self, order: Order) -> None:
        self._folder, self._begun = order.folder, False
        self._before = _unfinished(order)
        now = time.time()
        before = self._before.print_id if self._before else ""
        self._record = LinkRecord(
            pid=os.getpid(),
            address="",
            token="",
            job=str(order.job.resolve()),
            profile=order.profile,
            port=order.port,
            started=now,
            baud=order.baud,
            retreat=asdict(order.retreat),
            care=order.care.to_dict(),
            print_id=before if order.resume else new_print_id(now),
            session=secrets.token_hex(8),
        )
        self._record.save(order.folder)

    @property
    def print_id(self) -> str:
        """Identity of the print; empty for one to be gone on with whose record is an old one."""
        return self._record.print_id

    def begin(self, print_id: str, address: str, token: str) -> None:
        """Name the print whose journal has begun, and where its process listens."""
        self._begun, self._record = True, replace(self._record, print_id=print_id)
        replace(self._record, address=address, token=token).save(self._folder)

    def end(self, status: Status) -> None:
        """Leave the last record; on a full disk the journal must do."""
        record = replace(self._record, status=status.to_dict())
        if self._before is not None and not self._begun:
            refused = {"pid": record.pid, "error": status.error, "message": status.message}
            record = replace(self._before, address="", token="", refused=refused)
        try:
            record.save(self._folder)
        except OSError:
            log.exception("link.json can't be written")


def _unfinished(order: Order) -> LinkRecord | None:
    """Return the record of the folder's print whose part may be in the dish; None for none."""
    try:
        known = read_journal(order.folder / JOURNAL)
        finished = not known.begun or known.state is LinkState.DONE
        return None if finished and not order.resume else load_record(order.folder)
    except (JournalError, NoLink):
        return None


def _print(order: Order, contact: _Contact, wire: Wire | None) -> Status:
    printer = load(Printer, order.profile)
    refuse_unsent(printer, str(order.job))
    job = load_job(order.job, printer)
    refuse_park(order.care.look_park_mm, printer)
    file_lines = len(job)
    history = resumable(order.folder, job.sha256) if order.resume else None
    if history is not None:
        job = job.grown_by(history.inserts)
    port = wire.transport if wire else open_port(order.port, printer, order.baud)
    traffic = WireLog(Path(order.care.wire_log) if order.care.wire_log else None)
    transport = LoggedTransport(port, traffic)
    keeper = _Keeper(traffic, order.folder / FILE, len(history.alarms) if history else 0)
    path = order.folder / JOURNAL if order.resume else archive_journal(order.folder)
    heard = {"heard": path.stat().st_mtime} if order.resume else {}
    journal = Journal(path, reserve=True)
    try:
        listener, address, token = listen(order.folder)
        streamer = Streamer(
            Wiring(
                transport=transport,
                protocol=protocol_for(printer, transport.quiet_s, order.care),
                clock=RealClock(),
                journal=journal,
                printer=printer,
                retreat=order.retreat,
                fresh=wire.fresh if wire else True,
                on_status=lambda status: _publish(status, server, wire, keeper, streamer),
                room=wire.room if wire else None,
            ),
            job,
            order.care,
        )
        server = Server(listener, token, streamer)
        identity = contact.print_id if history is None else history.print_id
        journal.add(
            "job",
            id=identity,
            name=job.name,
            path=str(order.job.resolve()),
            sha256=job.sha256,
            lines=file_lines,
            profile=order.profile,
            port=order.port,
            pid=os.getpid(),
            started=time.time(),
            **heard,
            **({"accepted": list(order.care.accepted)} if order.care.accepted else {}),
            **this_user(),
            **origin(printer),
        )
        remember_folder(order.folder)
        contact.begin(identity, address, token)
        signal.signal(signal.SIGTERM, lambda *_: streamer.stop())  # a system that shuts down
        server.start()
        if wire:
            wire.on_start(streamer)
        try:
            return streamer.run(history)
        finally:
            server.finish()
            forget(address)
    finally:
        journal.close()
        traffic.close()
        if wire is None:
            transport.close()


_AFTERMATH_S: Final = 5.0
"""Time after an alarm for which traffic is kept as well."""


@dataclass
class _Keeper:
    """Keeps the last traffic in the print's folder when something went wrong.

    Attributes
    ----------
    traffic : WireLog
    path : Path
    alarms : int
        Those that it was kept for already.
    """

    traffic: WireLog
    path: Path
    alarms: int = 0
    _again_s: float = math.inf
    _lost_told: bool = False

    def look(self, status: Status) -> None:
        """Write it at each new alarm, what came of it a while later, and at a bad end."""
        ended_badly = status.ended and status.state is not LinkState.DONE
        now = time.monotonic()
        if status.alarms > self.alarms:
            self._again_s = now + _AFTERMATH_S
        elif now >= self._again_s or (status.ended and self._again_s < math.inf):
            self._again_s, ended_badly = math.inf, True
        if status.alarms > self.alarms or ended_badly:
            self.alarms = status.alarms
            with suppress(OSError):  # a full disk is the journal's affair
                self.traffic.keep(self.path)

    def lost_words(self) -> str:
        """Return, once, why the log that was asked for ends; else an empty text."""
        if not self.traffic.lost or self._lost_told:
            return ""
        self._lost_told = True
        return f"the wire log (--wire-log) ends here: {self.traffic.lost}; the print goes on"


def _publish(
    status: Status, server: Server, wire: Wire | None, keeper: _Keeper, streamer: Streamer
) -> None:
    keeper.look(status)
    if lost := keeper.lost_words():
        streamer.alarm(lost)
    server.publish(status)
    if wire:
        wire.on_status(status)


def ignore_signals() -> None:
    """Leave Ctrl-C and hang-ups to the client."""
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)


@contextmanager
def hold_folder(folder: Path, held: str = LOCK, what: str = "a print is running") -> Iterator[None]:
    """Hold the folder's lock (the file ``held``), which the system frees when the process dies."""
    with (folder / held).open("a+b") as handle:
        limit = time.monotonic() + _LOCK_PATIENCE_S
        while True:  # a client that looks whether anybody holds it does so for a moment
            try:
                lock(handle)
                break
            except OSError as exc:
                if time.monotonic() > limit:
                    raise AlreadyPrinting(
                        f"{what} in {folder}; attach to it, or give another folder"
                    ) from exc
                time.sleep(0.01)
        yield
