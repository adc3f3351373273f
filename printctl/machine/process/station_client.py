"""Client of a station: start or attach to its process, follow its status, send requests.

A client may go away at any time; the station doesn't mind. Every call opens a connection of its
own, so that one client may be used by several threads and nothing stands in the way of `kill`.
"""

from __future__ import annotations

import contextlib
import math
import socket
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Any, Final

from firmware_profiles import Printer, load
from printctl.machine.control.station_status import StationState, StationStatus
from printctl.machine.errors import BY_NAME, AlreadyPrinting, LinkError, NoLink, Refused
from printctl.machine.families import refuse_unsent
from printctl.machine.ports.detection import SIMULATED
from printctl.machine.process.client import PrintClient, wait_for_first_lines
from printctl.machine.process.client import attach as attach_print
from printctl.machine.process.detached_process import spawn
from printctl.machine.process.find_link import alive, has_ended, stays_alive
from printctl.machine.process.resuming import resumable
from printctl.machine.process.single_request import (
    messages,
    open_connection,
    request_answer,
    send_request,
)
from printctl.machine.process.station_record import (
    JOURNAL,
    LOCK,
    LOG,
    journalled_down,
    load_station,
)
from printctl.machine.records.journalled_print import read_journal
from printctl.machine.records.record import JOURNAL as PRINT_JOURNAL
from printctl.sources import python_command

if TYPE_CHECKING:
    from printctl.machine.process.find import Order


def order_to_json(order: Order) -> dict[str, Any]:
    """An order as a JSON object."""
    return {
        "job": str(order.job.resolve()),
        "printer": order.printer,
        "folder": str(order.folder.resolve()),
        "retreat": asdict(order.retreat),
        "care": order.care.to_dict(),
    }


SOON_S: Final = 10.0
MOVE_S: Final = 600.0
"""Longest wait for the end of a move: a slow axis, all of its way."""
CHECK_S: Final = 180.0
"""Longest wait for a printer that is connected, or a print that begins."""
FILES_BYTES: Final = 2**16
"""Of a station's record, journal and address, with room for the record's next version."""


class Station:
    """One client of a station; made by `connect` or `attach`.

    Every request is done when its call returns, and gives the status after it. What can't be
    granted raises `printctl.machine.errors.Refused`; a station that is gone, `NoLink`; a
    printer that fails meanwhile, another `LinkError`.

    Attributes
    ----------
    folder : Path
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._listening: set[socket.socket] = set()
        self._lock = threading.Lock()

    # --- what a client may hear ----------------------------------------------------------------

    @property
    def status(self) -> StationStatus:
        """The station as it is now; of one that has gone, the last word, as closed or lost."""
        try:
            return StationStatus.from_dict(request_answer(self.folder, "status", SOON_S))
        except NoLink:
            if alive(self.folder, LOCK):
                raise
        return _last_word(self.folder)

    def events(self) -> Iterator[StationStatus]:
        """Give each status as it comes, the present one first; ends when the station closes."""
        opened = open_connection(self.folder)
        if opened is None:
            yield _last_word(self.folder)
            return
        connection, record = opened
        with self._lock:
            self._listening.add(connection)
        last = None
        try:
            send_request(connection, record, "subscribe")
            for message in messages(connection, None):
                if message["event"] == "status":
                    last = StationStatus.from_dict(message)
                    yield last
        finally:
            with self._lock:
                left = connection not in self._listening
                self._listening.discard(connection)
            connection.close()
        if not left and (last is None or last.state is not StationState.CLOSED):
            yield _last_word(self.folder)

    def detach(self) -> None:
        """End `events` from any thread; the station goes on."""
        with self._lock:
            listening = list(self._listening)
            self._listening.clear()
        for connection in listening:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)

    # --- ends and emergencies --------------------------------------------------------------------

    def close(self) -> None:
        """Switch heaters off, let go of the port and end the process; refused while it moves."""
        request_answer(self.folder, "close", MOVE_S)
        limit = time.monotonic() + SOON_S
        while alive(self.folder, LOCK) and time.monotonic() < limit:
            time.sleep(0.02)

    def kill(self) -> None:
        """Halt the firmware past all queues, from any state and thread; nothing can block it."""
        request_answer(self.folder, "kill", SOON_S, answer=True)

    def stop_motion(self) -> StationStatus:
        """End a move by hand after at most half a second of it; the position stays known."""
        return self._request("stop_motion", SOON_S)

    def reconnect(self) -> StationStatus:
        """Open the port again and check the printer, after ``halted`` or ``lost``."""
        return self._request("reconnect", CHECK_S)

    # --- moves -----------------------------------------------------------------------------------

    def jog(
        self, axis: str | Mapping[str, float], mm: float = 0.0, speed_mm_s: float | None = None
    ) -> StationStatus:
        """Move the tip by ``mm`` along an axis, or by several axes' ``{"x": 1.0, "y": -1.0}``.

        Without a speed: 5 mm/s, or what the machine's slowest axis can.
        """
        by = {axis: mm} if isinstance(axis, str) else dict(axis)
        return self._request("jog", MOVE_S, by=by, speed_mm_s=speed_mm_s)

    def move_to(
        self,
        x: float | None = None,
        y: float | None = None,
        z: float | None = None,
        *,
        speed_mm_s: float | None = None,
    ) -> StationStatus:
        """Move the tip in a straight line to a place; refused unless the position is trusted."""
        return self._request("move_to", MOVE_S, x=x, y=y, z=z, speed_mm_s=speed_mm_s)

    def home(
        self, axes: Sequence[str] = ("x", "y", "z"), *, needle_off: bool = False
    ) -> StationStatus:
        """Home axes; refused with a needle mounted, unless it is taken off now (``needle_off``)."""
        return self._request("home", MOVE_S, axes=list(axes), needle_off=needle_off)

    def heat(self, name: str, celsius: float) -> StationStatus:
        """Set a heater's target (``nozzle``, ``bed``), 0 for off; doesn't wait for it."""
        return self._request("heat", MOVE_S, name=name, celsius=celsius)

    def plunger(self, ul: float, ul_s: float | None = None) -> StationStatus:
        """Push (above 0) or draw back so many µL, measured by the syringe mounted."""
        return self._request("plunger", MOVE_S, ul=ul, ul_s=ul_s)

    def command(self, text: str) -> list[str]:
        """Send a line by the console; while a print goes on, through its link. Give the reply."""
        return list(request_answer(self.folder, "command", MOVE_S, text=text)["lines"])

    # --- what the user tells ---------------------------------------------------------------------

    def mount(self, **parts: Any) -> StationStatus:
        """Say what is mounted: the fields of `Mounted`, and ``plunger_mm`` of a syringe put in.

        Keys left out stay as they are; ``""`` (or None) takes away. Another needle or dish must be
        touched off anew. A syringe that is named is full, unless ``plunger_mm`` says otherwise.
        """
        return self._request("mount", MOVE_S, **parts)

    def touch_off(self, z: float | None = None, *, foil_mm: float = 0.0) -> StationStatus:
        """Say that the tip touches the floor: here, or at ``z``, less the foil it stands on."""
        return self._request("touch_off", MOVE_S, z=z, foil_mm=foil_mm)

    def set_position(
        self, x: float | None = None, y: float | None = None, z: float | None = None
    ) -> StationStatus:
        """Tell the printer where its tip stands (G92); nothing moves."""
        return self._request("set_position", MOVE_S, x=x, y=y, z=z)

    # --- prints ----------------------------------------------------------------------------------

    def print(self, order: Order) -> PrintClient:
        """Print on the open port; gives a client of the print, once its first lines go out.

        Raises
        ------
        Refused
            For another printer's job, a tip that isn't where the job declares it, an order to go
            on with a print (`printctl resume` does that, without a station).
        LinkError
            When the print fails before its first line.
        """
        if order.resume:
            raise Refused(
                "a station has numbered the printer's lines anew, so an interrupted print can't be "
                "gone on with through it; see `printctl recover`"
            )
        if stays_alive(order.folder):
            raise AlreadyPrinting(f"a print is running in {order.folder}; attach to it")
        request_answer(self.folder, "print", CHECK_S, **order_to_json(order))
        return wait_for_first_lines(attach_print(order.folder))

    def _request(self, do: str, patience_s: float, **values: Any) -> StationStatus:
        return StationStatus.from_dict(
            request_answer(self.folder, do, patience_s, **values)["status"]
        )


def connect(
    profile: str,
    port: str,
    folder: Path,
    *,
    baud: int | str | None = None,
    sim_speed: float = 1.0,
    start_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
    discard_interrupted: bool = False,
) -> Station:
    """Start a station's process, and attach to it; returns once the printer has been checked.

    Parameters
    ----------
    profile : str
        Printer profile, by name or path.
    port : str
        Device, ``tcp:HOST:PORT``, ``auto``, or ``simulated``.
    folder : Path
        Where the station's record, journal and log go.
    baud : int or "auto", optional
        In place of the profile's.
    sim_speed : float
        Of a simulated printer, times real time; 0 for as fast as it can.
    start_mm : (x, y, z), mm
        Where a simulated printer's tip stands.
    discard_interrupted : bool
        Connect although a print of this station was interrupted, which then can't be gone on with.

    Raises
    ------
    AlreadyPrinting
        When a station is open in ``folder``: attach to it.
    Refused
        When its last print was interrupted and can be gone on with.
    LinkError
        When the printer can't be connected: port missing, denied or in use, no answer.
    OSError
        When the folder can't be written to, as on a full disk; nothing was started.
    """
    if sim_speed < 0 or not math.isfinite(sim_speed):
        raise Refused(f"sim_speed {sim_speed:g} isn't 0 or above")
    refuse_unsent(load(Printer, profile))
    folder.mkdir(parents=True, exist_ok=True)
    if stays_alive(folder, LOCK):
        raise AlreadyPrinting(
            f"a printer is connected in {folder}; {other_speed(folder, sim_speed)}"
            "attach to that station, or disconnect it first (`printctl station disconnect`)"
        )
    if not discard_interrupted and port != SIMULATED:
        _refuse_interrupted(folder)
    _check_room(folder)
    command = [
        *python_command("printctl.machine.process.station_main"),
        "--printer",
        profile,
        "--port",
        port,
    ]
    command += ["--folder", str(folder.resolve()), "--sim-speed", f"{sim_speed:g}"]
    command += ["--start=" + ",".join(f"{mm:.6f}" for mm in start_mm), "--detach"]
    command += ["--baud", str(baud)] if baud else []
    _await_station(spawn(command), folder)
    return Station(folder)


def attach(folder: Path) -> Station:
    """Attach to the station of ``folder``, which may have been closed since.

    Raises
    ------
    NoLink
        When none was ever opened there.
    """
    load_station(folder)
    return Station(folder)


def other_speed(folder: Path, sim_speed: float) -> str:
    """Name the speed of a connected simulated printer if it isn't ``sim_speed``; else empty."""
    try:
        speed = load_station(folder).sim_speed if stays_alive(folder, LOCK) else None
    except NoLink:
        speed = None
    if speed is None or speed == sim_speed:
        return ""
    return f"it is a simulated one at {speed:g} times real time, not {sim_speed:g}; "


def _check_room(folder: Path) -> None:
    """Raise unless a station could write its files, for on a full disk it couldn't say so."""
    try:
        with TemporaryFile(dir=folder) as probe:
            probe.write(bytes(FILES_BYTES))
            probe.flush()
    except OSError as exc:
        raise OSError(exc.errno, exc.strerror, str(folder)) from exc


def _refuse_interrupted(folder: Path) -> None:
    """Leave a printer alone that may still hold the place of a print."""
    try:
        last = load_station(folder).last
        if last.state is not StationState.PRINTING:
            return
        place = Path(last.print_folder)
        sha256 = str(read_journal(place / PRINT_JOURNAL).job.get("sha256", ""))
        history = resumable(place, sha256)
    except LinkError:
        return
    raise Refused(
        f"the print in {place} was interrupted after at least {history.done} of {history.total} "
        f"lines; connecting would make the printer forget its place. Go on with `printctl print "
        f"{history.job.get('path')} --folder {place} --resume`, or connect and discard it "
        "(discard_interrupted, --discard)"
    )


def _last_word(folder: Path) -> StationStatus:
    """Of a station that has gone."""
    record = load_station(folder)
    last = record.last
    if last.state in (StationState.CLOSED, StationState.LOST):
        return last
    state, message = journalled_down(folder / JOURNAL, record.started) or (last.state, "")
    if state is StationState.CLOSED:  # the disk was full, and its record couldn't be written
        return replace(last, state=state, message=message, position_mm=None, position_trusted=False)
    known = {
        "state": StationState.LOST,
        "message": f"the station ended without a word while {state.value}; connect again",
    }
    return StationStatus.from_dict({**last.to_dict(), **known, "error": "LinkError"})


def _await_station(pid: int, folder: Path) -> None:
    """Wait until the printer was checked, or that has failed."""
    limit = time.monotonic() + CHECK_S
    while time.monotonic() < limit:
        over = has_ended(pid)
        with contextlib.suppress(NoLink):
            record = load_station(folder)
            last = record.last
            if record.pid == pid and last.state is StationState.LOST and last.error:
                raise BY_NAME.get(last.error, LinkError)(last.message)
            if record.pid == pid and last.state is not StationState.CONNECTING:
                return
        if over:
            log = (folder / LOG).read_text(encoding="utf-8", errors="replace").splitlines()
            raise LinkError(f"the station ended at once: {log[-1] if log else 'no word'}")
        time.sleep(0.02)
    raise NoLink(f"the station didn't come up within {CHECK_S:g} s; see {folder / LOG}")
