"""Start processes: a print, one that goes on with an interrupted print, a station; or find them."""

from __future__ import annotations

import contextlib
import json
import math
import shlex
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryFile
from typing import Final, NoReturn

from firmware_profiles import Printer, load
from printctl.errors import PrintctlError, SafetyError
from printctl.machine.control.idle.station_status import StationState
from printctl.machine.errors import AlreadyPrinting, LinkError, NoLink, Refused
from printctl.machine.families import refuse_unsent
from printctl.machine.job.care import Care
from printctl.machine.job.job import load_job
from printctl.machine.job.retreat import Retreat
from printctl.machine.ports.detection import AUTO, SIMULATED, runs_files
from printctl.machine.ports.transport import locate
from printctl.machine.process.clients.client import (
    CHECK_S,
    PrintClient,
    Station,
    attach,
    error_of,
    wait_for_first_lines,
)
from printctl.machine.process.clients.launch import (
    START_LIMIT_S,
    await_process,
    interrupt_held,
    spawn,
)
from printctl.machine.process.contact import (
    STATION_LOCK,
    STATION_LOG,
    last_status,
    load_station,
    stays_alive,
)
from printctl.machine.process.host_print import refuse_on_host
from printctl.machine.process.orders import Order
from printctl.machine.process.outcome import followable, other_file_words, resumable
from printctl.machine.process.simulated import (
    is_complete_record,
    living_port,
    record_for,
    was_simulated,
)
from printctl.machine.records.record import JOURNAL, LOG, load_record
from printctl.machine.records.replay import read_journal
from printctl.machine.records.states import LinkState
from printctl.processes.alive import send_signal
from printctl.sources import python_command

FILES_BYTES: Final = 2**16
"""Of a station's record, journal and address, with room for the record's next version."""
_PROCESS: Final = "printctl.machine.process"


def stop_and_leave(client: PrintClient) -> NoReturn:
    """End a print whose start was interrupted; raise KeyboardInterrupt."""
    client.stop()
    client.detach()
    raise KeyboardInterrupt(f"the print in {client.folder} was cancelled")


def start_print(
    order: Order, on_interrupt: Callable[[PrintClient], None] = stop_and_leave
) -> PrintClient:
    """Start a process that prints a job on a port of its own, and attach to it.

    Returns once the printer has answered the handshake and the first lines go out. The order's port
    is a device, ``tcp:HOST:PORT``, ``socket://HOST:PORT``, or ``auto`` for the one with the
    profile's USB id; to resume is to go on with the print whose process died in its folder. Ctrl-C
    before the first lines calls ``on_interrupt`` once the process takes requests; where that
    returns, the print is waited for again.

    Raises
    ------
    AlreadyPrinting
        When a print's process is alive in the folder.
    LinkError
        When the print fails before its first line: port missing, denied or in use, no answer to
        the handshake, a job with a line that must not be sent.
    """
    folder, printer = order.folder, load(Printer, order.printer)
    folder.mkdir(0o700, parents=True, exist_ok=True)
    if stays_alive(folder):
        raise AlreadyPrinting(
            f"a print is running in {folder}; attach to it, or give another folder"
        )
    done = 0
    if order.resume and not runs_files(order.port):
        done = resumable(folder, load_job(order.job, printer).sha256).done
    if AUTO in (order.port, order.baud):
        place = locate(order.port, order.baud, printer)
        order = replace(order, port=place.port, baud=place.baud)
    command = [*python_command(_PROCESS), "--detach", "--print", json.dumps(order.to_json())]
    client: PrintClient | None = None
    while True:
        try:
            if client is None:
                with interrupt_held():
                    client = _listening(command, folder)
            return wait_for_first_lines(client, done)
        except KeyboardInterrupt:
            if client is None:
                raise
            on_interrupt(client)


def _listening(command: list[str], folder: Path) -> PrintClient:
    """Start a print's process; return a client once it listens, or has ended."""
    pid = spawn(command)

    def look() -> PrintClient | None:
        """Return a client once the process listens, or has ended."""
        try:
            record = load_record(folder)
        except NoLink:
            return None
        if record.refused.get("pid") == pid:
            raise error_of(record.refused["error"], record.refused["message"])
        ready = record.pid == pid and (record.address or record.status)
        return attach(folder) if ready else None

    try:
        return await_process(pid, "link process", look, folder / LOG, START_LIMIT_S)
    except NoLink:  # it mustn't begin to print after all
        with contextlib.suppress(OSError):
            send_signal(pid, signal.SIGTERM)
        raise


def resume_print(
    folder: Path,
    port: str | None = None,
    on_interrupt: Callable[[PrintClient], None] = stop_and_leave,
) -> PrintClient:
    """Go on with the print in ``folder``, whose process died or lost its port.

    The printer is asked for its last line. If it was reset, or its position isn't the job's, the
    print ends as ``position_unknown`` without a move. ``port`` is given where its name has changed;
    ``on_interrupt`` as for `start_print`.

    Raises
    ------
    Refused
        When the print has ended in another way, or never began.
    LinkError
        When there is no such print, it is running, or the port can't be used.
    """
    record = load_record(folder)
    order = Order(
        Path(record.job),
        record.profile,
        port or living_port(folder, record.port),
        folder,
        Retreat(**record.retreat),
        resume=True,
        care=Care.from_dict(record.care),
        baud=record.baud,
    )
    return start_print(order, on_interrupt)


def find_or_start(
    order: Order,
    open_port: Callable[[], str],
    on_interrupt: Callable[[PrintClient], None] = stop_and_leave,
) -> PrintClient:
    """Attach to the order's print if it is going on or done; else go on with it, or start it.

    What was interrupted on a real machine is neither repeated nor resumed unasked. A simulated
    printer is simply started anew, but for a print that a station has done (`order.once`).
    ``open_port`` gives the port, and is called only when a print is started; ``on_interrupt`` is
    called at Ctrl-C before its first lines, as by `start_print`.

    Raises
    ------
    PrintctlError
        When another file is being printed in the folder.
    SafetyError
        When the file's print was interrupted, and `resume` isn't set.
    LinkError
        When the print can't be started or gone on with; `Refused` for a printer that takes no
        lines from a host.
    """
    client = running(order)
    if client is not None:
        return client
    refuse_unsent(load(Printer, order.printer), str(order.job))
    if runs_files(order.port):
        return _find_or_start_on_host(order, open_port, on_interrupt)
    if order.resume:
        if order.port != SIMULATED and was_simulated(order.folder):
            raise SafetyError(
                f"the print in {order.folder} was a simulated one, and {order.port} has printed "
                "none of it; print the file from its beginning, in another folder"
            )
        if _journalled_hash(order.folder) not in ("", order.sha256):
            history = read_journal(order.folder / JOURNAL)
            raise SafetyError(other_file_words(order.folder, history))
        return resume_print(order.folder, open_port(), on_interrupt)
    counts = order.port != SIMULATED or is_complete_record(
        record_for(order.folder), order.sha256, load(Printer, order.printer)
    )
    if order.once and counts and (done := finished(order)) is not None:
        return done
    if order.port != SIMULATED:
        _refuse_interrupted(order)
    return start_print(replace(order, port=open_port()), on_interrupt)


def _find_or_start_on_host(
    order: Order, open_port: Callable[[], str], on_interrupt: Callable[[PrintClient], None]
) -> PrintClient:
    """Follow the file's print on a network host again where its end isn't known; else start it.

    Following starts nothing twice: see `printctl.machine.network.file_print`.
    """
    refuse_on_host(order)
    try:
        history = followable(order.folder)
    except LinkError:
        if order.resume:
            raise
        if order.once and (done := finished(order)) is not None:
            return done
    else:
        if history.sha256 != order.sha256:
            raise SafetyError(
                f"the print of another file in {order.folder} hasn't ended as far as is known, or "
                f"{order.job.name} (or its recipe) has changed since: look at the machine, then "
                f"give that print up (`printctl give-up {order.folder}`)"
            )
        return resume_print(order.folder, order.port, on_interrupt)
    return start_print(replace(order, port=open_port()), on_interrupt)


def running(order: Order) -> PrintClient | None:
    """Return a client of the order's print, if it is going on.

    PrintctlError when another file is being printed in the folder.
    """
    client = _attached(order.folder)
    if client is None or client.status.ended:
        return None
    if _journalled_hash(order.folder) != order.sha256:
        client.detach()
        raise PrintctlError(
            f"another file is being printed in {order.folder}, or {order.job.name} has changed "
            "since; wait for that print, or cancel it from a terminal with its own file"
        )
    return client


def finished(order: Order) -> PrintClient | None:
    """Return a client of the order's print, if it is done."""
    if order.port != SIMULATED and was_simulated(order.folder):
        return None  # a rehearsal is no print
    client = _attached(order.folder)
    if client is None or client.status.state is not LinkState.DONE:
        return None
    return client if _journalled_hash(order.folder) == order.sha256 else None


def _refuse_interrupted(order: Order) -> None:
    begun = _journalled_hash(order.folder)
    try:
        history = resumable(order.folder, begun)
    except LinkError:
        return
    if begun != order.sha256:
        raise SafetyError(
            f"a print was interrupted after at least {history.done} of {history.total} lines: "
            f"{other_file_words(order.folder, history)}"
        )
    raise SafetyError(
        f"the print of {order.job.name} was interrupted in {order.folder} after at least "
        f"{history.done} of {history.total} lines; if the printer kept its power, go on with "
        f"`printctl print {order.job} --printer {order.printer} --port {order.port} "
        f"{shlex.join([*order.care.set_up, '--folder', str(order.folder)])} --resume`; to start "
        "over, move that folder away"
    )


def _attached(folder: Path) -> PrintClient | None:
    try:
        return attach(folder)
    except NoLink:
        return None


def _journalled_hash(folder: Path) -> str:
    try:
        return str(read_journal(folder / JOURNAL).job.get("sha256", ""))
    except LinkError:
        return ""


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

    What is given is a `Plug`'s. ``discard_interrupted`` connects although a print of this station
    was interrupted, which then can't be gone on with.

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
    if runs_files(port):
        raise Refused(
            f"{port} runs files by itself, so no station stands by there: nothing can be moved, "
            "heated or looked at from here. Print by `printctl print` or `printctl run`, and move "
            "by the host's own page"
        )
    folder.mkdir(0o700, parents=True, exist_ok=True)
    if stays_alive(folder, STATION_LOCK):
        raise AlreadyPrinting(
            f"a printer is connected in {folder}; {other_speed(folder, sim_speed)}"
            "attach to that station, or disconnect it first (`printctl station disconnect`)"
        )
    if not discard_interrupted and port != SIMULATED:
        _refuse_interrupted_here(folder)
    _check_room(folder)
    plug = {
        "profile": profile,
        "port": port,
        "folder": str(folder.resolve()),
        "baud": baud,
        "sim_speed": sim_speed,
        "start_mm": start_mm,
    }
    command = [*python_command(_PROCESS), "--detach", "--station", json.dumps(plug)]
    pid = spawn(command)

    def look() -> Station | None:
        """Return a client once the printer was checked."""
        with contextlib.suppress(NoLink):
            record = load_station(folder)
            last = last_status(record)
            if record.pid == pid and last.state is StationState.LOST and last.error:
                raise error_of(last.error, last.message)
            if record.pid == pid and last.state is not StationState.CONNECTING:
                return Station(folder)
        return None

    return await_process(pid, "station", look, folder / STATION_LOG, CHECK_S)


def other_speed(folder: Path, sim_speed: float) -> str:
    """Name the speed of a connected simulated printer if it isn't ``sim_speed``; else empty."""
    try:
        speed = load_station(folder).sim_speed if stays_alive(folder, STATION_LOCK) else None
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


def _refuse_interrupted_here(folder: Path) -> None:
    """Leave a printer alone that may still hold the place of a print."""
    try:
        last = last_status(load_station(folder))
        if last.state is not StationState.PRINTING:
            return
        place = Path(last.print_folder)
        sha256 = str(read_journal(place / JOURNAL).job.get("sha256", ""))
        history = resumable(place, sha256)
    except LinkError:
        return
    raise Refused(
        f"the print in {place} was interrupted after at least {history.done} of {history.total} "
        f"lines; connecting would make the printer forget its place. Go on with `printctl print "
        f"{history.job.get('path')} --folder {place} --resume`, or connect and discard it "
        "(discard_interrupted, --discard)"
    )
