"""Run a print: its folder and link.json, its port where it has one alone, journal and wire log.

`serve_print` is the process of one print, on a port that is opened for it and given up after it. It
is started detached, ignores Ctrl-C and hang-ups, and goes on when the program that started it dies.
On a station's printer `printctl.machine.process.station_print` runs a print in the same way.
"""

from __future__ import annotations

import logging
import math
import os
import secrets
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

from firmware_profiles import Printer, ProfileError, load
from printctl.machine.control.board.connecting import protocol_for
from printctl.machine.control.board.wiring import Wiring
from printctl.machine.control.idle.known_state import Knowledge
from printctl.machine.control.idle.station_status import StationState
from printctl.machine.control.printing.looking import refuse_park
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.errors import JournalError, LinkError, NoLink
from printctl.machine.families import refuse_unsent
from printctl.machine.job.job import Job, load_job
from printctl.machine.network.host import KEY_FILE_VARIABLE
from printctl.machine.ports.clock import RealClock
from printctl.machine.ports.detection import SIMULATED, runs_files
from printctl.machine.ports.wire_log import FILE, LoggedTransport, WireLog
from printctl.machine.process.contact import hold_folder, refuse_shared_profile
from printctl.machine.process.host_print import run_host_print
from printctl.machine.process.machine import Machine, serve_in
from printctl.machine.process.orders import Order
from printctl.machine.process.outcome import resumable
from printctl.machine.process.plug import Plug
from printctl.machine.records.actor import this_user
from printctl.machine.records.folders import archive_journal, remember_folder
from printctl.machine.records.journal import Journal, new_print_id, origin
from printctl.machine.records.mounting import (
    Mounting,
    after_print,
    load_mounting,
    save_mounting,
)
from printctl.machine.records.printed_job import grown_in
from printctl.machine.records.record import JOURNAL, ContactRecord, load_record, reported_port
from printctl.machine.records.replay import read_journal
from printctl.machine.records.sealing import sign_journal
from printctl.machine.records.states import LinkState, Status

MIN_FREE_BYTES: Final = 16 * 2**20
"""Room on the disk before a print: its journal grows by 1 to 2 MiB an hour."""
HISTORY_LIMIT_S: Final = 2.0
"""Longest wait at a print's end for its place in the history."""
_AFTERMATH_S: Final = 5.0
"""Time after an alarm for which traffic is kept as well."""

log = logging.getLogger(__name__)


def serve_print(order: Order) -> Status:
    """Run one print in this process, on a port of its own; return its last status."""
    with contact_of(order) as contact, _mounted(order, contact) as used_mm:
        if runs_files(order.port):
            contact.status = run_host_print(order, contact, _begin_journal)
            return contact.status
        if used_mm is not None:
            order = replace(order, care=replace(order.care, used_mm=used_mm))
        plug = Plug(order.printer, order.port, order.folder, order.baud)
        machine = Machine(plug, Knowledge(plug.printer))
        machine.take_signals()
        contact.status = run_print(machine, order, contact)
    return contact.status


@contextmanager
def _mounted(order: Order, contact: PrintContact) -> Iterator[float | None]:
    """Keep what a print leaves in the printer's syringe; give the travel that is used up, mm.

    It isn't known while the print goes on, nor afterwards where this process dies, or went on with
    a print that another one began.
    """
    if reported_port(order.folder, order.port) == SIMULATED:
        yield None
        return
    kept = load_mounting(order.printer)
    refuse_shared_profile(kept.holder, order.folder, order.port)
    began = replace(kept, plunger_mm=None, holder=str(order.folder.resolve()))
    _keep(began)
    try:
        yield None if order.resume else kept.plunger_mm
        if contact.begun and contact.status.ended:
            printer = load(Printer, order.printer)
            job = grown_in(order.folder, load_job(order.job, printer))
            before = began if order.resume else replace(kept, holder=began.holder)
            _keep(after_print(before, printer, job, order.folder, contact.status))
    finally:
        if not contact.begun:
            _keep(kept)


def _keep(kept: Mounting) -> None:
    try:
        save_mounting(kept)
    except OSError:
        log.exception("what is mounted can't be kept")


class PrintContact:
    """The ``link.json`` of a print that is to be run.

    An unfinished print's stays where an attempt ends before it writes to the journal.

    Attributes
    ----------
    status : Status
        How the print stands, or has ended.
    begun : bool
        Whether its journal has begun, and clients find it.
    """

    def __init__(self, order: Order) -> None:
        self.status, self.begun = Status(LinkState.CONNECTING), False
        self._folder, self._before = order.folder, _unfinished(order)
        now = time.time()
        before = self._before.print_id if self._before else ""
        self._record = ContactRecord(
            pid=os.getpid(),
            address="",
            token="",
            job=str(order.job.resolve()),
            profile=order.printer,
            port=order.port,
            started=now,
            baud=order.baud if isinstance(order.baud, int) else None,
            retreat=asdict(order.retreat),
            care=order.care.to_dict(),
            print_id=before if order.resume else new_print_id(now),
            session=secrets.token_hex(8),
            key_file=_key_file(self._before if order.resume else None),
        )
        self._record.save(order.folder)

    @property
    def print_id(self) -> str:
        """Identity of the print; empty for one to be gone on with whose record is an old one."""
        return self._record.print_id

    def begin(self, print_id: str, address: str, token: str) -> None:
        """Name the print whose journal has begun, and where its process listens."""
        record = replace(self._record, print_id=print_id)
        with _disk_of(self._folder):
            replace(record, address=address, token=token).save(self._folder)
        self.begun, self._record = True, record

    def fail(self, message: str, error: str, known: bool = True) -> None:
        """Take this for the print's end."""
        self.status = Status(LinkState.FAILED, message=message, error=error, position_known=known)

    def end(self) -> None:
        """Leave the last record; on a full disk the journal must do."""
        status, record = self.status, replace(self._record, status=self.status.to_dict())
        if self._before is not None and not self.begun:
            refused = {"pid": record.pid, "error": status.error, "message": status.message}
            record = replace(self._before, address="", token="", refused=refused)
        try:
            record.save(self._folder)
        except OSError:
            log.exception("link.json can't be written")


def _key_file(before: ContactRecord | None) -> str:
    """Return the absolute path of a network host's key file; the environment's comes first."""
    given = os.environ.get(KEY_FILE_VARIABLE, "")
    return os.path.abspath(given) if given else (before.key_file if before else "")


def _unfinished(order: Order) -> ContactRecord | None:
    """Return the record of the folder's print whose part may be in the dish; None for none."""
    try:
        known = read_journal(order.folder / JOURNAL)
        finished = not known.begun or known.state is LinkState.DONE
        return None if finished and not order.resume else load_record(order.folder)
    except (JournalError, NoLink):
        return None


@contextmanager
def _disk_of(path: Path) -> Iterator[None]:
    """Say by a LinkError that a print's folder, or file, can't be written before its first line."""
    try:
        yield
    except OSError as exc:
        raise LinkError(
            f"{path} can't be written to: {exc.strerror}; free space on the disk, or name "
            "another folder; no line of the job was sent"
        ) from exc


@contextmanager
def contact_of(order: Order) -> Iterator[PrintContact]:
    """Hold the print's folder and keep its record; what fails within is the print's end.

    AlreadyPrinting when a print holds the folder; LinkError when it can't be written to.
    """
    with ExitStack() as parting:
        with _disk_of(order.folder):
            order.folder.mkdir(0o700, parents=True, exist_ok=True)
            parting.enter_context(hold_folder(order.folder))
            contact = PrintContact(order)
        try:
            yield contact
        except (LinkError, ProfileError) as exc:
            log.error("%s", exc)
            contact.fail(str(exc), type(exc).__name__)
        except Exception as exc:
            log.exception("the link process met an error of its own")
            message = f"the link process failed: {exc!r}; see link.log"
            contact.fail(message, "LinkError", known=False)
            raise
        finally:
            contact.end()


def run_print(
    machine: Machine,
    order: Order,
    contact: PrintContact,
    on_begin: Callable[[Streamer], None] = lambda streamer: None,
) -> Status:
    """Print, from handshake to end, on the machine's port.

    A machine without an open port opens it, and a socket in the print's folder, and gives both up
    after the print. ``on_begin`` is given the print's streamer once its clients can reach it.
    LinkError or ProfileError when the print can't begin.
    """
    printer, plug = machine.plug.printer, machine.plug
    refuse_unsent(printer, str(order.job))
    job = load_job(order.job, printer)
    refuse_park(order.care.look_park_mm, printer)
    file_lines = len(job)
    history = resumable(order.folder, job.sha256) if order.resume else None
    if history is not None:
        job = job.grown_by(history.inserts)
    _refuse_full_disk(order.folder)
    alone = plug.transport is None
    with ExitStack() as parting:
        wire_log = Path(order.care.wire_log) if order.care.wire_log else None
        with _disk_of(wire_log or order.folder):
            traffic = WireLog(wire_log)
        parting.callback(traffic.close)
        if alone:
            parting.callback(plug.close)
        port = plug.transport or plug.open()
        transport = LoggedTransport(port, traffic)
        keeper = _WireKeeper(traffic, order.folder / FILE, len(history.alarms) if history else 0)
        with _disk_of(order.folder):
            path = order.folder / JOURNAL if order.resume else archive_journal(order.folder)
        heard = {"heard": path.stat().st_mtime} if order.resume else {}
        journal = Journal(path, reserve=True, sign=sign_journal)
        parting.callback(journal.close)

        def on_status(status: Status) -> None:
            keeper.look(status)
            if lost := keeper.lost_words():
                streamer.alarm(lost)
            machine.publish(status)

        wiring = Wiring(
            transport=transport,
            protocol=protocol_for(printer, transport.quiet_s, order.care),
            clock=RealClock(),
            journal=journal,
            printer=printer,
            retreat=order.retreat,
            fresh=alone or plug.simulated,
            on_status=on_status,
            room=None if alone else lambda: machine.known.limits,
        )
        streamer = Streamer(wiring, job, order.care)
        if alone:
            serve_in(machine, order.folder, parting)
        identity = contact.print_id if history is None else history.print_id
        _begin_journal(journal, order, job, printer, id=identity, lines=file_lines, **heard)
        remember_folder(order.folder, streamer.alarm)
        machine.begin_print(streamer, identity)
        machine.enter(StationState.PRINTING, f"printing {job.name}", print_folder=str(order.folder))
        contact.begin(identity, *machine.listens_at)
        on_begin(streamer)
        status = streamer.run(history)
        remember_folder(order.folder).join(HISTORY_LIMIT_S)  # where it couldn't be before
        return status


def _refuse_full_disk(folder: Path) -> None:
    free = shutil.disk_usage(folder).free
    if free < MIN_FREE_BYTES:
        raise LinkError(
            f"{free / 2**20:.1f} MiB are free on the disk of {folder}, and a print needs "
            f"{MIN_FREE_BYTES / 2**20:g} MiB for its journal; free some, or name a folder on "
            "another disk (--folder); no line of the job was sent"
        )


def _begin_journal(
    journal: Journal, order: Order, job: Job, printer: Printer, **given: Any
) -> None:
    """Write down which print this is, of what, where and whose; ``given`` comes with it."""
    journal.add(
        "job",
        name=job.name,
        path=str(order.job.resolve()),
        relative=os.path.relpath(order.job.resolve(), order.folder.resolve()),
        sha256=job.sha256,
        profile=order.printer,
        port=order.port,
        pid=os.getpid(),
        started=time.time(),
        **given,
        **({"accepted": list(order.care.accepted)} if order.care.accepted else {}),
        **this_user(),
        **origin(printer),
    )
    journal.add("action", do="resume" if order.resume else "start", **order.by)


@dataclass
class _WireKeeper:
    """Keeps the last traffic in the print's folder when something went wrong.

    Attributes
    ----------
    alarms : int
        Those that it was kept for already.
    """

    traffic: WireLog
    path: Path
    alarms: int = 0
    _again_s: float = math.inf
    _lost_reported: bool = False

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
        if not self.traffic.lost or self._lost_reported:
            return ""
        self._lost_reported = True
        return f"the wire log (--wire-log) ends here: {self.traffic.lost}; the print goes on"
