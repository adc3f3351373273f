"""Emergency stop (M112) from every state, and recovery; loss of printer or host."""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from firmware_profiles import Printer, load
from printctl.failures import message_and_code
from printctl.machine.control.idle.known_state import Knowledge
from printctl.machine.control.idle.station_status import StationState, StationStatus
from printctl.machine.errors import LinkError, NoLink, PortLost, Refused
from printctl.machine.job.retreat import Retreat
from printctl.machine.process import station as station_module
from printctl.machine.process.clients.client import Station, attach_station
from printctl.machine.process.clients.launch import spawn
from printctl.machine.process.clients.starting import connect
from printctl.machine.process.contact import STATION_RECORD, load_station
from printctl.machine.process.machine import Machine, Request
from printctl.machine.process.orders import Order
from printctl.machine.process.plug import Plug
from printctl.machine.records.record import ContactRecord
from printctl.machine.records.states import LinkState
from tests.printctl.machine.link.fake_marlin import FakeMarlin, PtyPrinter, pty_printer, write_job
from tests.waiting import wait_for

PRINTER = load(Printer, "generic_marlin")


class Listening(FakeMarlin):
    """Remembers all that it was told, halted or not, and tells its temperature unasked."""

    heard = b""

    def _reply(self, word: str, command: str) -> str:
        said = super()._reply(word, command)
        if word == "M115":
            return f"Cap:AUTOREPORT_TEMP:1\n{said}"
        return f"{said} T:36.60 /37.00 B:20.00 /0.00 @:0\n" if command == "M155 S2" else said

    def receive(self, data: bytes) -> bytes:
        self.heard += data
        return super().receive(data)


def all_heard(served) -> bytes:
    """Return all that was sent: a slow computer repeats M112, and a repeat after a reset halts."""
    heard = b""
    while heard != (heard := served.printer.heard):
        time.sleep(0.5)
    return heard


def until(station: Station, *states: StationState) -> str:
    for status in station.events():
        if status.state in states:
            return status.message
    raise AssertionError(f"never {states}")


def print_on(station: Station, folder: Path, profile: str, moves: int) -> tuple[Any, list[str]]:
    """Print a job on a station; return the client and the job's lines."""
    lines = write_job(folder / "job.gcode", moves)
    order = Order(folder / "job.gcode", profile, "", folder / "run", Retreat())
    return station.print(order), lines


def held_print(fake: Any, folder: Path, profile: str) -> Any:
    """A print on a station whose printer holds its answers back until it is let go."""
    served, station = fake
    served.hold_at = served.printer.last + 400
    client, _ = print_on(station, folder, profile, 5000)
    assert served.held.wait(10)
    return client


def let_go(served: PtyPrinter) -> None:
    served.hold_at = None
    served.gate.set()


@pytest.fixture
def fake(folder, profile):
    with pty_printer(Listening()) as served:
        station = connect(profile, served.name, folder)
        yield served, station
        if station.status.state is not StationState.CLOSED:
            try:
                station.close()
            except (Refused, NoLink):
                os.kill(load_station(folder).pid, signal.SIGKILL)


def test_killed_while_it_stands_by(fake):
    served, station = fake
    station.kill()
    message = until(station, StationState.HALTED)
    assert "M112 left the host after" in message
    assert served.printer.halted
    with pytest.raises(Refused, match="halted: emergency stop by the user"):
        station.jog("x", 1)
    before = all_heard(served)
    station.kill()  # once more does no harm
    wait_for(lambda: served.printer.heard != before)
    all_heard(served)
    served.printer.reset()
    assert station.reconnect().state is StationState.READY
    assert not station.status.position_trusted


class Unconfirming(Listening):
    """Neither takes nor confirms M112 until it is told to."""

    deaf = True

    def receive(self, data: bytes) -> bytes:
        if self.deaf and b"M112" in data:
            self.heard += data
            return b""
        return super().receive(data)


def test_halting_is_told_until_the_printer_confirms(folder, profile):
    with pty_printer(Unconfirming()) as served:
        station = connect(profile, served.name, folder)
        station.kill()
        message = until(station, StationState.HALTING)
        assert "isn't confirmed yet" in message
        assert station.status.state is StationState.HALTING
        served.printer.deaf = False
        until(station, StationState.HALTED)
        station.close()


def test_simulated_klipper_confirms_while_it_stands_by(folder):
    station = connect("klipper_bioprinter", "simulated", folder, sim_speed=1.0)
    station.kill()
    message = until(station, StationState.HALTED)
    assert "confirmed the halt" in message
    station.close()


def test_killed_while_it_moves(fake):
    served, station = fake
    station.set_position(100, 100, 100)
    served.hold_at = served.printer.last + 5  # the printer takes a line and says nothing
    mover = attach_station(station.folder)
    ended: list[str] = []

    def move() -> None:
        try:
            mover.jog("x", 50, speed_mm_s=5)
        except Exception as exc:
            ended.append(str(exc))

    thread = threading.Thread(target=move)
    thread.start()
    assert served.held.wait(10)
    station.kill()
    let_go(served)
    message = until(station, StationState.HALTED)
    thread.join(10)
    assert ended[0].startswith("emergency stop by the user; M410 left the host after")
    assert message.startswith(ended[0])
    assert "itself" not in message
    assert served.printer.halted


def test_killed_while_it_prints(fake, tmp_path, profile):
    served, station = fake
    client = held_print(fake, tmp_path, profile)
    station.kill()
    let_go(served)
    assert client.wait(10).state is LinkState.KILLED
    assert "print halted" in until(station, StationState.HALTED)
    assert served.printer.halted


def test_killed_while_it_connects_to_a_printer_that_says_nothing(folder, profile):
    master, slave = os.openpty()
    try:
        folder.mkdir()
        command = [sys.executable, "-m", "printctl.machine.process", "--detach", "--station"]
        plug = {"profile": profile, "port": os.ttyname(slave), "folder": str(folder)}
        spawn([*command, json.dumps(plug)])
        heard, limit = b"", time.monotonic() + 30
        while b"N" not in heard and time.monotonic() < limit:  # it speaks, so it can be reached
            if select.select([master], [], [], 0.1)[0]:
                heard += os.read(master, 4096)
        attach_station(folder).kill()
        heard = b""
        while b"M112" not in heard and time.monotonic() < limit:
            if select.select([master], [], [], 0.1)[0]:
                heard += os.read(master, 4096)
        assert b"\nM112\n" in heard
    finally:
        os.kill(load_station(folder).pid, signal.SIGKILL)
        os.close(master)
        os.close(slave)


def test_unplugged_is_lost_and_says_so(folder, profile):
    with pty_printer(FakeMarlin()) as served:
        station = connect(profile, served.name, folder)
        station.set_position(50, 50, 50)
        served.unplug_at = served.printer.last + 2
        message = until(station, StationState.LOST)
        assert "reconnect" in message
        assert not station.status.position_trusted
        with pytest.raises(Refused, match="lost"):
            station.jog("x", 1)
        station.close()
    assert station.status.state is StationState.CLOSED


def test_reset_board_is_noticed(fake):
    served, station = fake
    station.set_position(50, 50, 50)
    served.printer.reset_at = served.printer.last + 2
    message = until(station, StationState.HALTED)
    assert "was reset" in message
    served.printer.reset_at = -1
    assert station.reconnect().state is StationState.READY


def test_print_uses_the_open_port_and_returns_it(fake, tmp_path, profile):
    served, station = fake
    station.mount(syringe="bd_1ml")
    client, lines = print_on(station, tmp_path, profile, 200)
    assert client.wait(20).state is LinkState.DONE
    assert until(station, StationState.READY).startswith("print done")
    sent = served.printer.numbered
    begin = sent.index(lines[4])
    assert sent[begin : begin + len(lines) - 4] == lines[4:]
    assert station.status.plunger_mm == pytest.approx(1.99)
    assert not station.status.position_trusted, "the job said nothing of where it was"


def test_refused_while_it_prints_and_console_goes_through(fake, tmp_path, profile):
    served, station = fake
    client = held_print(fake, tmp_path, profile)
    held = client.status
    assert {one.name: one.now_c for one in station.status.temperatures}["nozzle"] == 36.6
    assert 300 < held.lines_executed == held.lines_done - 20, "planner and queue hold so many"
    with pytest.raises(Refused, match="a print is running in"):
        station.jog("x", 1)
    with pytest.raises(Refused, match="a print is running in"):
        station.close()
    assert station.status.state is StationState.PRINTING
    let_go(served)
    assert station.command("M105")[0].startswith("ok T:")
    assert client.wait(300).state is LinkState.DONE


def test_dead_station_is_told_and_its_print_isnt_thrown_away(fake, folder, tmp_path, profile):
    served, station = fake
    held_print(fake, tmp_path, profile).detach()
    os.kill(load_station(folder).pid, signal.SIGKILL)
    until(station, StationState.LOST)
    let_go(served)
    with pytest.raises(Refused, match=r"was interrupted after at least \d+ of 5004 lines"):
        connect(profile, served.name, folder)
    again = connect(profile, served.name, folder, discard_interrupted=True)
    assert again.status.state is StationState.READY


class WithoutParser(Listening):
    """Its profile says that it has one."""

    def _reply(self, word: str, command: str) -> str:
        said = super()._reply(word, command)
        return said.replace("PARSER:1", "PARSER:0") if word == "M115" else said


def test_move_whose_station_dies_may_go_on_and_says_so(fake, folder):
    served, station = fake
    station.set_position(100, 100, 100)
    served.hold_at = served.printer.last + 5
    said: list[BaseException] = []

    def move() -> None:
        try:
            attach_station(folder).jog("x", 50, speed_mm_s=5)
        except LinkError as exc:
            said.append(exc)

    thread = threading.Thread(target=move)
    thread.start()
    assert served.held.wait(10)
    os.kill(load_station(folder).pid, signal.SIGKILL)
    thread.join(20)
    let_go(served)
    assert "`printctl station emergency-stop` halts the printer" in station.status.message
    assert message_and_code(said[0]) == (str(said[0]), 4)
    assert "may move on" in str(said[0])
    with pytest.raises(NoLink, match="no printer is connected"):
        station.jog("x", 1)
    station.kill()
    assert served.printer.halted
    served.printer.reset()
    connect(load_station(folder).profile, served.name, folder)


@pytest.mark.parametrize("kind", [Listening, WithoutParser])
def test_kill_opens_the_port_of_a_station_whose_process_has_died(folder, profile, kind):
    with pty_printer(kind()) as served:
        station = connect(profile, served.name, folder)
        os.kill(load_station(folder).pid, signal.SIGKILL)
        served.printer.heard = b""
        station.kill()
        assert served.printer.halted
        assert (b"M410" in served.printer.heard) == (kind is Listening)
    status = attach_station(folder).status
    assert (status.state, status.position_trusted) == (StationState.LOST, False)
    assert status.message.startswith("emergency stop by the user; M")
    assert status.message.endswith("then connect again")


def test_kill_halts_the_print_of_a_station_whose_process_has_died(fake, folder, tmp_path, profile):
    served, station = fake
    client = held_print(fake, tmp_path, profile)
    os.kill(load_station(folder).pid, signal.SIGKILL)
    let_go(served)
    station.kill()
    assert served.printer.halted
    assert client.wait(10).state is LinkState.KILLED
    assert "before, the print was interrupted" in station.status.message
    assert "the needle wasn't lifted and may be in the print" in station.status.message
    assert "M112 switches the heaters off" in station.status.message
    served.printer.reset()
    connect(profile, served.name, folder)


@pytest.mark.parametrize("port", ["/dev/nowhere", "closed"])
def test_kill_of_a_dead_station_that_halts_nothing_says_so(folder, port):
    folder.mkdir()
    state = StationState.CLOSED if port == "closed" else StationState.BUSY
    status = StationStatus(state, profile="generic_marlin", port=port)
    record = ContactRecord(1, "", "", "", "generic_marlin", port, 1.0, status=status.to_dict())
    record.save(folder, STATION_RECORD)
    said = "no printer is connected" if port == "closed" else "not halted, cut the printer's power"
    with pytest.raises(LinkError, match=said):
        attach_station(folder).kill()


def test_stopped_move_ends_early_and_is_known(fake):
    _, station = fake
    station.set_position(100, 100, 100)
    moved: list[float] = []
    other = attach_station(station.folder)

    def move() -> None:
        status = other.jog("x", 90, speed_mm_s=5)
        assert status.position_mm is not None
        moved.append(status.position_mm[0])

    thread = threading.Thread(target=move)
    thread.start()
    until(station, StationState.BUSY)
    with pytest.raises(Refused, match="a move is in progress"):
        station.jog("y", 1)
    station.stop_motion()
    thread.join(20)
    assert 100 <= moved[0] < 190
    assert station.status.position_trusted
    assert station.jog("x", -1).position_mm == (pytest.approx(moved[0] - 1), 100, 100)


def test_stop_refuses_to_end_what_only_a_kill_ends(tmp_path):
    machine = Machine(Plug("generic_marlin", "simulated", tmp_path), Knowledge(PRINTER))
    answers: list[dict[str, Any]] = []
    machine.enter(StationState.BUSY, "jog")
    machine._stop_motion(answers.append)
    machine.enter(StationState.BUSY, "home")
    with pytest.raises(Refused, match="homing can't be stopped"):
        machine._stop_motion(answers.append)
    assert len(answers) == 1


@pytest.mark.parametrize(
    ("do", "text", "what"), [("home", "", "home"), ("command", "g28 x", "home"), ("jog", "", "jog")]
)
def test_homing_is_named_however_it_is_asked_for(tmp_path, do, text, what):
    machine, told = Machine(Plug("generic_marlin", "simulated", tmp_path), Knowledge(PRINTER)), []
    machine.enter = lambda state, message, **_: told.append(message)  # type: ignore[method-assign]
    with contextlib.suppress(PortLost):
        station_module._by_hand(machine, Request(do, {"text": text}, lambda _: None))
    assert told[0] == what


# --- another program's lines to an idle printer: its position becomes unknown
def write_as_another(served: PtyPrinter, data: bytes) -> None:
    port = os.open(served.name, os.O_RDWR | os.O_NOCTTY)
    os.write(port, data)
    os.close(port)


def test_line_of_another_program_takes_a_standing_printers_place(folder, profile):
    with pty_printer(FakeMarlin()) as served:
        station = connect(profile, served.name, folder)
        station.set_position(100, 100, 50)
        assert station.status.position_trusted
        write_as_another(served, b"G92 X0 Y0\n")
        assert "another program or noise wrote to it" in until(station, StationState.HALTED)
        assert not station.status.position_trusted
        assert station.reconnect().state is StationState.READY
        assert not station.status.position_trusted
        station.close()


def test_line_of_another_program_pauses_a_print_above_the_dish_and_takes_its_place(
    folder, profile, tmp_path
):
    with pty_printer(FakeMarlin(), hold_at=40) as served:
        station = connect(profile, served.name, folder)
        station.set_position(0, 0, 0)
        client, _ = print_on(station, tmp_path, profile, 120)
        assert served.held.wait(20)
        write_as_another(served, b"G1 X90\n")
        served.gate.set()
        wait_for(lambda: client.status.state is LinkState.PAUSED)
        assert served.printer.at["Z"] >= 0.5 + Retreat().lift_mm
        client.resume()
        assert client.wait(300).state is LinkState.DONE
        assert "another program" in until(station, StationState.HALTED)
        assert not station.status.position_trusted
        station.close()
