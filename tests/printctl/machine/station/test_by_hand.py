"""Manual moves of an idle simulated printer; unsafe ones refused."""

from __future__ import annotations

import json
import threading
from typing import Any
from unittest.mock import MagicMock

import pytest

from firmware_profiles import Printer, load
from firmware_profiles.families.link_protocol import LineRefused
from gcode.motion.state import Board
from printctl.checks.gate import Bounds, NotAllowed, PrinterSituation, check_heat
from printctl.checks.gate.firmware import differences
from printctl.machine.control.board.heat import Temperature
from printctl.machine.control.board.steps import Steps
from printctl.machine.control.idle.idle_commands import IdleCommands
from printctl.machine.control.idle.known_state import Knowledge, heat_limits, read_mounted_profiles
from printctl.machine.control.idle.standby_events import StandbyEvents
from printctl.machine.control.idle.station_status import StationState
from printctl.machine.errors import AlreadyPrinting, HandshakeError, Refused
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.ports.detection import PortPrograms
from printctl.machine.process.clients.client import attach_station
from printctl.machine.process.clients.starting import connect
from printctl.machine.records.mounting import MountedParts
from printctl.machine.records.states import LinkState, PrintEnded
from sim.devices.families.marlin_printer import MarlinPrinter
from tests.printctl.cli.shell import Shell
from tests.printctl.machine.link.layered import Script, layered, played
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import PRINTER as PRINTER_LEVELLING
from tests.printctl.machine.link.simulated import START
from tests.printctl.machine.link.stepping import ended


def test_tells_where_it_stands_and_how_warm_it_is(at_rest):
    status = at_rest.status
    assert status.state is StationState.READY
    assert status.firmware.startswith("Marlin")
    assert status.position_mm == (100, 100, 50)
    assert status.position_trusted
    assert [one.name for one in status.temperatures] == ["nozzle", "bed"]
    assert status.soft_low_mm == (0, 0, 0)
    assert status.soft_high_mm == (200, 200, 200)


def test_jogs_and_goes_to_places(at_rest):
    assert at_rest.jog("x", 1.5).position_mm == (101.5, 100, 50)
    assert at_rest.jog({"y": -2, "z": 0.05}, speed_mm_s=2).position_mm == (101.5, 98, 50.05)
    assert at_rest.move_to(z=60).position_mm == (101.5, 98, 60)


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        (lambda s: s.jog("x", 101), "outside 0 to 200 mm"),
        (lambda s: s.move_to(z=-1), "outside 0 to 200 mm"),
        (lambda s: s.jog("x", 1, speed_mm_s=301), "exceeds 300 mm/s"),
        (lambda s: s.jog("z", 1, speed_mm_s=6), "exceeds 5 mm/s .max_speed_mm_s.z"),
        (lambda s: s.jog("q", 1), "axis q is none of"),
        (lambda s: s.jog("x", float("nan")), "isn't a finite number|can't be read"),
        (lambda s: s.heat("bed", 60), "outside 0 to 45 °C"),
        (lambda s: s.heat("chamber", 30), "tells of no 'chamber'"),
        (lambda s: s.plunger(1), "no syringe is specified"),
        (lambda s: s.command("G92 X0"), "isn't for manual use"),
        (lambda s: s.command("G1 Z-5"), "outside 0 to 200 mm"),
        (lambda s: s.command("M140 S90"), "outside 0 to 45 °C"),
        (lambda s: s.mount(needle="no_such"), "no_such"),
        (lambda s: s.mount(hat="bowler"), "'hat' can't be mounted"),
        (lambda s: s.set_position(x=-5), "the tip can't be there"),
        (lambda s: s.set_position(), "no axis is specified"),
        (lambda s: s.touch_off(), "specify them first"),
        (lambda s: s.reconnect(), "is connected"),
    ],
)
def test_refusal_says_why_and_moves_nothing(at_rest, asked, why):
    with pytest.raises(Refused, match=why):
        asked(at_rest)
    status = at_rest.status
    assert status.state is StationState.READY
    assert status.position_mm == (100, 100, 50)


def test_homing_needs_the_needle_off(at_rest):
    at_rest.mount(needle="25g", dish="petri_60mm")
    with pytest.raises(Refused, match=r"needle .25G, half an inch. mounted above the dish"):
        at_rest.home()
    with pytest.raises(Refused, match="would drive it"):
        at_rest.command("G28 Z")
    status = at_rest.home(("x", "y"), needle_off=True)
    assert status.position_mm is not None
    assert status.position_mm[:2] == (0, 0)
    assert status.mounted.needle == ""


def test_console_homes_only_once_it_is_known_whether_a_needle_is_on():
    known = Knowledge(PRINTER_LEVELLING)
    standing = Standing(MarlinPrinter(PRINTER_LEVELLING, START, Board()))
    hands = IdleCommands(standing, known)  # type: ignore[arg-type]
    with pytest.raises(Refused, match=r"is unknown whether a needle is mounted.*Home"):
        hands.grant("command", {"text": "G28 X"})
    assert standing.sent == []
    known.mount({"needle": ""})
    hands.grant("command", {"text": "G28 X"})
    assert standing.sent[0] == "G28 X"


def test_floor_is_touched_off_and_then_held(at_rest):
    at_rest.mount(needle="25g", dish="petri_60mm", dish_centre_mm=(100, 100))
    at_rest.set_position(z=4)
    with pytest.raises(Refused, match="isn't touched off"):
        at_rest.jog("z", -2)
    at_rest.jog("z", -1)
    status = at_rest.touch_off(foil_mm=0.5)
    assert status.mounted.floor_mm == 2.5
    assert status.soft_low_mm[2] == pytest.approx(2.5, abs=1e-4)
    with pytest.raises(Refused, match=r"below the dish's floor, touched off at 2.50 mm"):
        at_rest.jog("z", -0.6)
    assert at_rest.set_position(z=0.5).mounted.floor_mm == 0
    with pytest.raises(Refused, match="of the wall of"):
        at_rest.jog("x", 40)
    assert at_rest.mount(needle="27g").mounted.floor_mm is None


def test_plunger_goes_by_microlitres_within_its_syringe(at_rest):
    at_rest.mount(syringe="bd_1ml", ink="gelatin_sacrificial", plunger_mm=50)
    status = at_rest.plunger(2)
    assert status.ul_left is not None
    full = at_rest.mount(plunger_mm=50).ul_left
    assert full is not None
    assert full - status.ul_left == pytest.approx(2, abs=0.01)
    with pytest.raises(Refused, match="left in bd_1ml"):
        at_rest.plunger(full + 1)
    with pytest.raises(Refused, match="would be full there"):
        at_rest.plunger(-1000)
    with pytest.raises(Refused, match="plunger_ul_s of"):
        at_rest.plunger(1, ul_s=50)
    for _ in range(5):
        at_rest.plunger(0.1)
    left = at_rest.plunger(-0.5).ul_left
    assert left == pytest.approx(full, abs=1e-6)


def test_heater_is_set_and_told(at_rest):
    at_rest.heat("bed", 37)
    for status in at_rest.events():
        if {one.name: one.target_c for one in status.temperatures}["bed"] == 37:
            break
    at_rest.heat("bed", 0)


def test_line_that_is_never_taken_ends_the_standby():
    channel = MagicMock()
    channel.now = 0.0
    channel.wiring.transport.programs.return_value = PortPrograms()
    events = StandbyEvents(channel, threading.Event())
    events.found = True
    with pytest.raises(
        PrintEnded, match=r"didn't accept 'M114' in 100 attempts.*restart it"
    ) as ended:
        events.handle(LineRefused(7, 100, "M114", 0, "Error:checksum mismatch"))
    assert (ended.value.state, ended.value.known) == (LinkState.FAILED, False)


def test_every_listener_hears_and_a_dead_one_doesnt_matter(at_rest):
    dead = at_rest.events()
    next(dead)
    other = attach_station(at_rest.folder)
    listening, busy = threading.Event(), threading.Event()

    def listen() -> None:
        for status in other.events():
            listening.set()
            if status.state is StationState.BUSY:
                busy.set()

    thread = threading.Thread(target=listen)
    thread.start()
    assert listening.wait(10)
    at_rest.jog("y", 1)
    assert busy.wait(10)
    other.detach()
    thread.join(10)
    assert not thread.is_alive()
    assert at_rest.jog("y", -1).position_mm == (100, 100, 50)


def test_second_station_in_the_folder_is_refused(at_rest, monkeypatch):
    monkeypatch.setattr("printctl.machine.process.contact._ENDING_S", 0.1)
    with pytest.raises(AlreadyPrinting, match="at 0 times real time, not 30; attach"):
        connect("generic_marlin", "simulated", at_rest.folder, sim_speed=30)


# --- `printctl station` from the command line: connect, query, move
@pytest.fixture
def shell(monkeypatch, capsys, at_rest):
    inner = Shell(monkeypatch, capsys, "station")

    def run(*command: str) -> tuple[int, str, str]:
        return inner(*command, "--folder", str(at_rest.folder))

    return run


def test_moves_and_tells(shell):
    code, out, _ = shell("jog", "--x", "2", "--z", "-1", "--json")
    assert code == 0
    assert json.loads(out)["position_mm"] == [102, 100, 49]
    assert "tip at X100.00 Y100.00 Z49.00" in shell("jog", "--to", "--x", "100")[1]
    code, out, _ = shell("status")
    assert out.startswith("ready: ")
    assert "nozzle 21" in out


def test_says_what_is_mounted_and_pushes(shell):
    out = shell("mount", "--syringe", "bd_1ml", "--needle", "25g", "--dish-centre", "100,100")[1]
    assert "mounted: needle 25g, syringe bd_1ml" in out
    before = json.loads(shell("status", "--json")[1])["ul_left"]
    after = json.loads(shell("push", "--ul", "1", "--json")[1])["ul_left"]
    assert before - after == pytest.approx(1, abs=0.01)


def test_sends_a_line_and_gives_the_reply(shell):
    code, out, _ = shell("send", "M114")
    assert (code, out[:8]) == (0, "X:100.00")


def test_touches_off_and_counts_anew(shell):
    shell("mount", "--needle", "25g", "--dish", "petri_60mm")
    assert "floor of the dish at Z 49.90 mm" in shell("touch-off", "--foil", "0.1")[1]
    assert "floor of the dish at Z 0.00 mm" in shell("where", "--z", "0.1")[1]


@pytest.mark.parametrize(
    ("command", "code", "why"),
    [
        (("jog", "--x", "200"), 1, "outside 0 to 200 mm"),
        (("jog",), 2, "no axis is named"),
        (("mount",), 2, "nothing is named"),
        (("mount", "--dish-centre", "middle"), 2, "isn't X,Y in mm"),
        (("heat", "bed", "90"), 1, "outside 0 to 45 °C"),
        (("send", "M112"), 1, "isn't for manual use"),
        (("reconnect",), 1, "is connected"),
    ],
)
def test_refusal_is_one_line_and_an_exit_code(shell, command, code, why):
    found, _, said = shell(*command)
    assert found == code
    assert why in " ".join(said.split())


def test_without_a_station_it_says_so(monkeypatch, capsys, tmp_path):
    code, _, said = Shell(monkeypatch, capsys, "station")("status", "--folder", str(tmp_path))
    assert code == 1
    assert "connect first" in said


# --- declarations about the printer (mounted parts, positions), and what they invalidate
PRINTER = load(Printer, "generic_marlin")


@pytest.fixture
def known() -> Knowledge:
    found = Knowledge(PRINTER)
    found.homed = (True, True, True)
    found.mount({"needle": "25g", "syringe": "bd_1ml", "dish": "petri_60mm"})
    return found


def test_heights_and_places_go_along_with_a_new_count(known):
    known.mount({"floor_mm": 3.0, "bath_level_mm": 9.0, "dish_centre_mm": (100, 90)})
    known.count_anew((10, 10, 10), (11, 10, 8), {"x", "z"})
    assert known.mounted.floor_mm == 1.0
    assert known.mounted.bath_level_mm == 7.0
    assert known.mounted.dish_centre_mm == (101, 90)


def test_place_of_the_dish_was_told_in_the_true_frame(known):
    known.mount({"floor_mm": 3.0, "bath_level_mm": 9.0})
    known.lose_position()
    assert (known.mounted.floor_mm, known.mounted.bath_level_mm) == (None, None)
    known.mount({"dish_centre_mm": (100, 90)})
    known.count_anew((0, 0, 0), (50, 60, 70), {"x", "y", "z"})
    assert known.mounted.dish_centre_mm == (100, 90)
    assert known.trusted


@pytest.mark.parametrize(
    "said",
    [
        {"plunger_mm": -1},
        {"plunger_mm": "full"},
        {"plunger_mm": -1, "needle": "18g"},
        {"floor_mm": 10**400},
        {"needle": 3},
        {"dish_centre_mm": [1]},
        {"dish_centre_mm": [1, None]},
        {"floor_mm": float("nan")},
        {"bath_level_mm": True},
        {"dish": "bucket"},
        {"glove": "left"},
    ],
)
def test_nonsense_is_refused_and_changes_nothing(known, said):
    before = (known.mounted, known.plunger_mm, known.homed, known.profiles)
    with pytest.raises(Refused):
        known.mount(said)
    assert (known.mounted, known.plunger_mm, known.homed, known.profiles) == before


# --- bed levelling and skew correction active in the firmware: refused or switched off
SLOPE = 0.01


class Standing:
    """A standing printer that is told commands, as far as `IdleCommands` needs one."""

    position, temperatures = START, ()

    def __init__(self, printer: MarlinPrinter) -> None:
        self.transport, self.sent = SimTransport(printer, VirtualClock()), list[str]()

    def do(self, *commands: str) -> Steps[list[str]]:
        yield from ()
        self.sent += commands
        self.transport.write("".join(f"{one}\n" for one in commands).encode())
        said = b""
        while said.splitlines().count(b"ok") < len(commands):
            said += self.transport.read(1.0)
        return said.decode().splitlines()

    def look(self) -> Steps[None]:
        yield from self.do("M114")

    @staticmethod
    def drive(steps: Steps[Any]) -> Any:
        return ended(steps)


def homed(board: Board) -> tuple[dict[str, Any], Standing]:
    """Home X and Y of a printer by hand; return the answer, and it."""
    standing = Standing(MarlinPrinter(PRINTER_LEVELLING, START, board))
    hands = IdleCommands(standing, Knowledge(PRINTER_LEVELLING))  # type: ignore[arg-type]
    return hands.grant("home", {"axes": ["x", "y"]}), standing


def test_levelling_that_homing_by_hand_switches_on_is_off_again():
    answer, standing = homed(Board(bed_slope=SLOPE, levels_after_homing=True))
    assert "homing switched bed levelling on" in answer["message"]
    assert any("M420 S0" in line for line in ended(standing.do("M503 S0")))


def test_levelling_that_is_on_before_the_start_is_refused(tmp_path):
    printer = MarlinPrinter(PRINTER_LEVELLING, START, Board(bed_slope=SLOPE))
    transport = SimTransport(printer, VirtualClock())
    transport.write(b"M420 S1\n")
    while transport.read(1.0):
        pass
    status = played(layered(1, 10), tmp_path, transport, Script())
    assert (status.state, status.error) == (LinkState.FAILED, HandshakeError.__name__)
    assert "bed levelling is on (M420 S1)" in status.message
    assert len(printer.executed()) == 0


@pytest.mark.parametrize(
    ("line", "factors"),
    [
        ("  M852 I0.010000 J0.000000 K-0.002000 ; XY, XZ, YZ", "I0.010000 K-0.002000"),
        ("  M852 I0.010000 ; XY", "I0.010000"),
    ],
)
def test_skew_correction_is_refused_with_its_factors(line, factors):
    (found,) = differences({"M503 S0": [line]}, load(Printer, "marlin_avr"))
    assert f"skew correction is on (M852 {factors})" in found.what
    assert not found.reset
    assert not found.tolerated


# --- temperatures by firmware, and limits of mounted materials
def check_target(known, name, celsius, profiles, part_in_dish):
    told = tuple(one.name for one in known)
    limits = heat_limits(profiles, part_in_dish)
    check_heat(PrinterSituation(Bounds(PRINTER), heat=limits, heaters=told), name, celsius)


BOTH = (Temperature("nozzle", 21.0, 0.0), Temperature("bed", 21.0, 0.0))


def test_ink_and_bath_limit_what_they_bear():
    profiles = read_mounted_profiles(
        MountedParts(ink="gelatin_sacrificial", bath="gelatin_support")
    )
    ink, bath = profiles.ink, profiles.bath
    assert ink is not None
    assert bath is not None
    assert bath.melt_out_c is not None
    check_target(BOTH, "nozzle", ink.temperature_c.high, profiles, False)
    with pytest.raises(NotAllowed, match=r"temperature_c of"):
        check_target(BOTH, "nozzle", ink.temperature_c.high + 0.1, profiles, False)
    with pytest.raises(NotAllowed, match=r"max_printing_c of"):
        check_target(BOTH, "bed", bath.melt_out_c, profiles, False)
    check_target(BOTH, "bed", bath.melt_out_c, profiles, True)


@pytest.mark.parametrize("celsius", [45.1, -1.0])
def test_without_a_name_no_more_than_cells_bear(celsius):
    with pytest.raises(NotAllowed, match="outside 0 to 45"):
        check_target(BOTH, "nozzle", celsius, read_mounted_profiles(MountedParts()), False)


def test_off_is_always_right():
    check_target((), "bed", 0, read_mounted_profiles(MountedParts()), False)
    with pytest.raises(NotAllowed, match="tells of no 'oven'"):
        check_target((), "oven", 0, read_mounted_profiles(MountedParts()), False)
