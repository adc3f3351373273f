"""Run a station as a separate process that owns the printer's port.

It is started detached (a session of its own), ignores Ctrl-C and hang-ups, and goes on when the
program that started it dies. It ends when it is closed.
"""

from __future__ import annotations

import logging
import os
import signal
import time
from dataclasses import dataclass, replace
from pathlib import Path

from firmware_profiles import Printer, ProfileError, load
from printctl.machine.control.known_state import Knowledge
from printctl.machine.control.station_status import MountedParts, Place, StationState, StationStatus
from printctl.machine.errors import LinkError, NoLink
from printctl.machine.families import refuse_unsent
from printctl.machine.ports.detection import SIMULATED
from printctl.machine.process.open_connection import Socket
from printctl.machine.process.process import hold_folder, ignore_signals
from printctl.machine.process.station_loop import StationLoop
from printctl.machine.process.station_record import (
    JOURNAL,
    LOCK,
    RECORD,
    SOCKET,
    StationRecord,
    load_station,
)
from printctl.machine.process.station_server import StationServer, forget, listen
from printctl.machine.records.journal import Journal

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Opening:
    """What a station is told when it is opened.

    Attributes
    ----------
    profile : str
        By name or path.
    port : str
    folder : Path
        For journal, record and log.
    baud : int, "auto" or None
    sim_speed : float
    start_mm : (x, y, z), mm
        Where a simulated tip stands.
    """

    profile: str
    port: str
    folder: Path
    baud: int | str | None
    sim_speed: float
    start_mm: Place


def serve_station(opening: Opening) -> StationStatus:
    """Run a station in this process until it is closed.

    Returns
    -------
    StationStatus
        The last one; it is in the folder's ``station.json``, too.
    """
    folder = opening.folder
    folder.mkdir(parents=True, exist_ok=True)
    with hold_folder(folder, LOCK, "a printer is connected"):
        ignore_signals()
        record = StationRecord(
            pid=os.getpid(),
            address="",
            token="",
            profile=opening.profile,
            port=opening.port,
            baud=opening.baud if isinstance(opening.baud, int) else None,
            started=time.time(),
            sim_speed=opening.sim_speed if opening.port == SIMULATED else None,
        )
        before = _before(folder)
        if before is not None:  # a station that dies before it is open has learnt nothing else
            record = _with_what_was_known(record, before)
        _begin(record, folder)
        try:
            record, status = _open(opening, record, before)
        except (LinkError, ProfileError) as exc:
            log.error("%s", exc)
            status = _failed(record, str(exc), type(exc).__name__)
        except Exception as exc:
            log.exception("the station met an error of its own")
            message = f"the station failed: {exc!r}; see station.log"
            status = _failed(record, message, "LinkError")
            raise
        finally:
            _save(replace(record, address="", token="", status=status.to_dict()), folder)
    return status


def _with_what_was_known(record: StationRecord, before: StationRecord) -> StationRecord:
    return replace(
        record,
        status=replace(record.last, mounted=before.mounted).to_dict(),
        plunger_mm=before.plunger_mm,
        part_in_dish=before.part_in_dish,
    )


def _begin(record: StationRecord, folder: Path) -> None:
    """Write the first record: without it no client would find the station.

    Raises
    ------
    LinkError
    """
    try:
        record.save(folder)
    except OSError as exc:
        raise LinkError(
            f"{folder / RECORD} can't be written: {exc.strerror}; free space on the disk, or name "
            "another folder; nothing was sent to the printer"
        ) from exc


def _save(record: StationRecord, folder: Path) -> None:
    """Write a record; on a full disk the older one stays, and the journal says the rest."""
    try:
        record.save(folder)
    except OSError:  # a full disk mustn't end a station that holds a needle in a gel
        log.exception("%s can't be written", RECORD)


def _failed(record: StationRecord, message: str, error: str) -> StationStatus:
    return StationStatus(
        StationState.LOST,
        message,
        profile=record.profile,
        port=record.port,
        error=error,
        mounted=record.mounted,
    )


def _before(folder: Path) -> StationRecord | None:
    """What the last station here knew."""
    try:
        return load_station(folder)
    except NoLink:
        return None


def _open(
    opening: Opening, record: StationRecord, before: StationRecord | None
) -> tuple[StationRecord, StationStatus]:
    printer = load(Printer, opening.profile)
    refuse_unsent(printer)
    journal = Journal(opening.folder / JOURNAL)
    known = Knowledge(printer, before.mounted if before else MountedParts())
    if before is not None:
        known.plunger_mm, known.part_in_dish = before.plunger_mm, before.part_in_dish
    socket = Socket(
        opening.profile, printer, opening.port, opening.baud, opening.folder, opening.sim_speed
    )
    loop = StationLoop(socket, known, journal, opening.start_mm)
    listener, address, token = listen(opening.folder, SOCKET)
    server = StationServer(listener, token, loop)
    keeper = _Keeper(replace(record, address=address, token=token), opening.folder, loop, server)
    try:
        signal.signal(signal.SIGTERM, lambda *_: loop.leave())
        server.start()
        keeper.save(loop.status)
        loop.subscribe(keeper.tell)
        loop.connect()
        loop.run()
    finally:
        server.finish()
        forget(address)
        journal.close()
    return keeper.latest(loop.status), loop.status


class _Keeper:
    """Tells the clients of each change, and writes down what must outlive the process."""

    def __init__(
        self, record: StationRecord, folder: Path, loop: StationLoop, server: StationServer
    ) -> None:
        self._record, self._folder, self._loop, self._server = record, folder, loop, server
        self._kept: tuple[object, ...] = ()

    def tell(self, status: StationStatus) -> None:
        self._server.tell_all(status.to_dict())
        kept = (status.state, status.mounted, status.plunger_mm, self._loop.known.part_in_dish)
        if kept != self._kept:
            self._kept = kept
            self.save(status)

    def save(self, status: StationStatus) -> None:
        _save(self.latest(status), self._folder)

    def latest(self, status: StationStatus) -> StationRecord:
        return replace(
            self._record,
            status=status.to_dict(),
            plunger_mm=self._loop.known.plunger_mm,
            part_in_dish=self._loop.known.part_in_dish,
        )
