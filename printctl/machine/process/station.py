"""Process of a printer that stays connected: attend to it, grant requests, run prints, reconnect.

It ends when a client closes it. What must outlive it is in ``station.json``, and on a full disk in
its journal.
"""

from __future__ import annotations

import contextlib
import logging
import math
import os
import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from firmware_profiles import ProfileError
from printctl.machine.control.board.connecting import protocol_for
from printctl.machine.control.board.wiring import Wiring
from printctl.machine.control.idle.idle_commands import AXES, IdleCommands
from printctl.machine.control.idle.known_state import Knowledge
from printctl.machine.control.idle.standby import Standby
from printctl.machine.control.idle.station_status import Place, StationState, StationStatus
from printctl.machine.control.position.place import MOVED
from printctl.machine.errors import HandshakeError, LinkError, NoLink, PortLost, Refused
from printctl.machine.families import refuse_unsent
from printctl.machine.ports.clock import RealClock
from printctl.machine.process.contact import (
    STATION_JOURNAL,
    STATION_LOCK,
    STATION_RECORD,
    STATION_SOCKET,
    hold_folder,
    last_status,
    load_station,
    refuse_shared_profile,
    save_station,
    without_place,
)
from printctl.machine.process.machine import DOWN, HOMING, Machine, Request, serve_in
from printctl.machine.process.plug import Plug
from printctl.machine.process.socket_server import refusal
from printctl.machine.process.station_print import print_here
from printctl.machine.process.vocabulary import WORDS, Idle
from printctl.machine.records.journal import Journal
from printctl.machine.records.mounting import (
    MountedParts,
    Mounting,
    as_kept,
    load_mounting,
    mounting_file,
    save_mounting,
)
from printctl.machine.records.record import ContactRecord
from printctl.machine.records.states import LinkState, PrintEnded, Status, state_words

IDLE_S: Final = 0.03
"""Longest wait for the printer before requests are looked at."""
_DOWN_S: Final = 0.2
"""Longest wait for a request while the printer can't be spoken to."""

ASTRAY_MM: Final = 0.03
"""Beyond what M114's two decimals leave open of a place."""

log = logging.getLogger(__name__)


def serve_station(plug: Plug) -> StationStatus:
    """Run a station in this process until it is closed; return its last status."""
    folder = plug.folder
    folder.mkdir(0o700, parents=True, exist_ok=True)
    with hold_folder(folder, STATION_LOCK, "a printer is connected"):
        _migrate_mounting(plug)
        record = _first_record(plug)
        try:
            record.save(folder, STATION_RECORD)  # without it no client would find the station
        except OSError as exc:
            raise LinkError(
                f"{folder / STATION_RECORD} can't be written: {exc.strerror}; free space on the "
                "disk, or name another folder; nothing was sent to the printer"
            ) from exc
        try:
            record, status = _open(plug, record)
        except (LinkError, ProfileError) as exc:
            log.error("%s", exc)
            record = _last_record(record, folder)
            status = _failed(record, str(exc), type(exc).__name__)
        except Exception as exc:
            log.exception("the station met an error of its own")
            record = _last_record(record, folder)
            status = _failed(record, f"the station failed: {exc!r}; see station.log", "LinkError")
            raise
        finally:
            save_station(replace(record, address="", token="", status=status.to_dict()), folder)
    return status


def _first_record(plug: Plug) -> ContactRecord:
    """Return the record of a station that isn't open yet, with what is kept of its printer."""
    record = ContactRecord(
        pid=os.getpid(),
        address="",
        token="",
        job="",
        profile=plug.profile,
        port=plug.port,
        baud=plug.baud if isinstance(plug.baud, int) else None,
        started=time.time(),
        sim_speed=plug.sim_speed if plug.simulated else None,
    )
    return replace(record, status=replace(last_status(record), mounted=_kept(plug).parts).to_dict())


def _migrate_mounting(plug: Plug) -> None:
    """Keep what an earlier version's station record says is mounted, where nothing is kept yet.

    How full the syringe is isn't taken over: prints since then may have used it.
    """
    within = plug.folder if plug.simulated else None
    if mounting_file(plug.profile, within).exists():
        return
    with contextlib.suppress(NoLink, ValueError, TypeError, KeyError):
        old = load_station(plug.folder)
        parts, key = last_status(old).mounted, as_kept(plug.profile)
        if as_kept(old.profile) == key and parts != MountedParts():
            save_mounting(Mounting(key, parts), within)
            log.info("what is mounted was taken over from %s", plug.folder / STATION_RECORD)


def _kept(plug: Plug) -> Mounting:
    return load_mounting(plug.profile, plug.folder if plug.simulated else None)


def _last_record(first: ContactRecord, folder: Path) -> ContactRecord:
    """Return the record with all that was known when the station failed."""
    with contextlib.suppress(NoLink):
        return load_station(folder)
    return first


def _failed(record: ContactRecord, message: str, error: str) -> StationStatus:
    last = replace(last_status(record), state=StationState.LOST, message=message, error=error)
    return without_place(last)


def _open(plug: Plug, record: ContactRecord) -> tuple[ContactRecord, StationStatus]:
    refuse_unsent(plug.printer)
    kept = _kept(plug)
    if not plug.simulated:
        refuse_shared_profile(kept.holder, plug.folder, plug.port)
    known = Knowledge(plug.printer, kept.parts)
    known.take_over(kept)
    with ExitStack() as parting:
        journal = Journal(plug.folder / STATION_JOURNAL)
        parting.callback(journal.close)
        machine = Machine(plug, known, journal)
        machine.take_signals()
        serve_in(machine, plug.folder, parting, STATION_SOCKET)
        address, token = machine.listens_at
        machine.keep(replace(record, address=address, token=token))
        connect(machine)
        run(machine)
        return machine.kept(machine.status) or record, machine.status


def connect(machine: Machine, ready: str = "ready", *, trusted: bool = True) -> None:
    """Open the port, find the printer and check it; ``ready`` is the message once that is done.

    A simulated printer, ``trusted``, stands where it was started; after a stop it isn't: like
    any board it must be homed then, or told its place. LinkError when it fails; the port is closed.
    """
    plug = machine.plug
    machine.switching, machine.standby = True, None  # what the last one was asked for is over
    machine.enter(StationState.CONNECTING, f"opening {plug.port}", error="")
    try:
        plug.open()
        stand_by(machine, fresh=True)
    except (PrintEnded, LinkError) as exc:
        plug.close()
        raise exc if isinstance(exc, LinkError) else HandshakeError(exc.message) from exc
    finally:
        machine.switching = False
    if plug.simulated and trusted and machine.idle is not None:
        idle = machine.idle
        idle.standby.drive(idle.declare(plug.start_mm, set(AXES)))
    machine.write_down("state", state="ready", message="connected", port=plug.port)
    machine.enter(StationState.READY, ready)


def stand_by(machine: Machine, fresh: bool) -> None:
    """Speak through the open port."""
    transport, printer = machine.plug.opened(), machine.known.printer
    assert machine.journal is not None  # a print alone doesn't stand by
    wiring = Wiring(
        transport=transport,
        protocol=protocol_for(printer, transport.quiet_s),
        clock=RealClock(),
        journal=machine.journal,
        printer=printer,
        fresh=fresh,
    )
    standby = Standby(wiring, machine.plug.pace, machine.tell_live)
    machine.stand_by(standby)
    standby.drive(standby.begin())
    machine.idle = IdleCommands(standby, machine.known)


def _reconnect(machine: Machine) -> None:
    machine.plug.close()
    try:
        connect(machine, trusted=False)
    except LinkError as exc:
        go_down(machine, StationState.LOST, str(exc), type(exc).__name__)
        raise


def _end_by(machine: Machine, exc: PrintEnded | PortLost) -> None:
    """Record that the printer has halted or is gone, and its place with it."""
    if isinstance(exc, PortLost):
        go_down(machine, StationState.LOST, str(exc), type(exc).__name__)
        return
    lost = exc.state is LinkState.FAILED or exc.error == PortLost.__name__
    go_down(machine, StationState.LOST if lost else StationState.HALTED, exc.message, exc.error)


def go_down(machine: Machine, state: StationState, message: str, error: str = "") -> None:
    """Record that the printer can't be used until it is connected again."""
    if state is StationState.LOST:
        machine.plug.close()
    if machine.standby is not None and machine.standby.position is not None:
        machine.plug.start_mm = machine.standby.position
    remedy = "" if "reconnect" in message else "; see to the printer, then reconnect"
    waiting = machine.fall_silent(state, message + remedy, error)
    machine.write_down("state", state=state.value, message=message)
    machine.tell_live()
    for request in waiting:
        request.reply(refusal(LinkError(message)))


def _after_print(machine: Machine, status: Status, at: Place | None = None) -> None:
    """Stand by again where the printer still knows its place; else say why not.

    ``at``: where it stood before the print.
    """
    ended = f"print {state_words(status.state)}: {status.message}"
    if status.error == PortLost.__name__ and status.state is not LinkState.KILLED:
        go_down(machine, StationState.LOST, ended, status.error)
    elif status.state is LinkState.KILLED or not status.position_known:
        go_down(machine, StationState.HALTED, ended, status.error)
    else:
        try:
            _stand_by_again(machine, ended, None if status.lines_done else at)
        except PrintEnded as exc:
            go_down(machine, StationState.HALTED, f"{ended}; {exc.message}", exc.error)
        except LinkError as exc:
            go_down(machine, StationState.LOST, f"{ended}; {exc}", type(exc).__name__)


def _stand_by_again(machine: Machine, ended: str, at: Place | None) -> None:
    """Stand by behind a print; a simulated printer is started anew.

    ``at``: where it still has to stand, None for no matter where.
    """
    if machine.plug.simulated:
        connect(machine, ended, trusted=machine.known.trusted)
        return
    stand_by(machine, fresh=False)
    if machine.reports and machine.standby is not None:
        machine.standby.drive(machine.standby.do("M155 S0"))
    now = machine.standby.position if machine.standby is not None else None
    if at is not None and (now is None or math.dist(at, now) > ASTRAY_MM):
        machine.known.lose_position()
        ended += f"; it doesn't stand where it stood before the print: {MOVED}; see where it is"
    machine.enter(StationState.READY, ended)


def run(machine: Machine) -> None:
    """Serve until closed; the printer has been connected (`connect`)."""
    while not machine.closing:
        try:
            if machine.state in DOWN:
                request = machine.next_request(_DOWN_S)
            else:
                request = machine.next_request()
                if request is None and machine.standby is not None:
                    machine.standby.drive(machine.standby.rest(IDLE_S))
            if request is not None:
                _attend(machine, request)
        except (PrintEnded, PortLost) as exc:
            _end_by(machine, exc)
    if machine.state is not StationState.CLOSED:
        _close(machine)


def _attend(machine: Machine, request: Request) -> None:
    """Do what is asked for, and answer."""
    try:
        if request.do == "print":
            at = machine.standby.position if machine.standby is not None else None
            _after_print(machine, print_here(machine, request), at)
        elif request.do == "close":
            _close(machine)
            machine.grant(request)
        elif request.do == "reconnect":
            if machine.state not in DOWN:
                raise Refused("the printer is connected; close the station first, or kill")
            _reconnect(machine)
            machine.grant(request)
        elif machine.state in DOWN:
            _mount(machine, request.values)
            machine.tell_live()
            machine.grant(request)
        else:
            machine.grant(request, _by_hand(machine, request))
    except LinkError as exc:
        machine.answer(request, refusal(exc))
        if isinstance(exc, PortLost) and machine.state not in DOWN:
            raise
    except PrintEnded as exc:
        machine.answer(request, refusal(LinkError(exc.message)))
        raise


def _by_hand(machine: Machine, request: Request) -> dict[str, Any]:
    """Have the standing printer do what is asked for; return the answer."""
    do, before = request.do, machine.message
    machine.write_down("asked", do=do, values=request.values, **request.by)
    if WORDS[do].idle is Idle.MOVES:
        typed_home = do == "command" and "G28" in request.values["text"].upper()
        machine.enter(StationState.BUSY, HOMING if typed_home else do)
    try:
        if do == "mount":
            answer = _mount(machine, request.values)
        else:
            if machine.idle is None:
                raise PortLost(f"{machine.plug.port} isn't open")
            answer = machine.idle.grant(do, request.values)
    except PortLost:
        raise
    except LinkError as exc:
        machine.enter(StationState.READY, before if isinstance(exc, Refused) else str(exc))
        raise
    machine.enter(StationState.READY, str(answer.get("message") or "ready"))
    return answer


def _mount(machine: Machine, values: dict[str, Any]) -> dict[str, Any]:
    printer = machine.known.printer
    if printer.heads and {"needle", "dish", "syringe"} & set(values):
        raise Refused(
            f"{printer.name} has several heads; what each of them holds can't be "
            "told to a station yet, only to a print"
        )
    machine.known.mount(values)
    return {}


def _close(machine: Machine) -> None:
    """Switch the heaters off where the printer answers, and let go of the port."""
    message, standby = "closed", machine.standby
    if machine.state not in DOWN and standby is not None:
        with contextlib.suppress(LinkError, PrintEnded):
            on = ", ".join(standby.drive(standby.let_go()))
            message = f"closed; {on} stays on (safe_state_on)" if on else "closed; heaters off"
    machine.closing = True
    if standby is not None:
        standby.end()
    machine.plug.close()
    machine.known.lose_position()
    machine.write_down("state", state="closed", message=message)
    machine.enter(StationState.CLOSED, message, position_mm=None)
