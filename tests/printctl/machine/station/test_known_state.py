"""Declarations about the printer (mounted parts, positions), and what they invalidate."""

from __future__ import annotations

from typing import Any

import pytest

from firmware_profiles import Printer, load
from printctl.checks.gate import Bounds, NotAllowed, PrinterSituation, check_heat
from printctl.checks.gate.firmware import differences
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.errors import HandshakeError, Refused
from printctl.machine.link.states import LinkState
from printctl.machine.link.temperatures import Temperature
from printctl.machine.station.idle_commands import IdleCommands
from printctl.machine.station.known_state import Knowledge, heat_limits
from printctl.machine.station.mounted_profiles import read_mounted_profiles
from printctl.machine.station.status import MountedParts
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.gcode.motion.hardware import Board
from tests.printctl.machine.link.layered import Script, layered, played
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import PRINTER as PRINTER_LEVELLING
from tests.printctl.machine.link.simulated import START

PRINTER = load(Printer, "generic_marlin")


@pytest.fixture
def known() -> Knowledge:
    found = Knowledge(PRINTER)
    found.homed = (True, True, True)
    found.mount({"needle": "25g", "syringe": "bd_1ml", "dish": "petri_60mm"})
    return found


def test_another_needle_has_another_length(known):
    known.mount({"floor_mm": 3.0})
    known.mount({"needle": "25g"})
    assert known.trusted, "it is the same"
    known.mount({"needle": "27g"})
    assert known.homed == (True, True, False)
    assert known.mounted.floor_mm is None


def test_a_needle_put_on_after_homing_has_a_length_that_nobody_knows():
    known = Knowledge(PRINTER)
    known.home({"x", "y", "z"})
    assert known.trusted
    known.mount({"needle": "25g"})
    assert not known.trusted


def test_heights_and_places_go_along_with_a_new_count(known):
    known.mount({"floor_mm": 3.0, "bath_level_mm": 9.0, "dish_centre_mm": (100, 90)})
    known.count_anew((10, 10, 10), (11, 10, 8), {"x", "z"})
    assert known.mounted.floor_mm == 1.0
    assert known.mounted.bath_level_mm == 7.0
    assert known.mounted.dish_centre_mm == (101, 90)


def test_place_of_the_dish_was_told_in_the_true_frame(known):
    known.lose_position()
    known.mount({"dish_centre_mm": (100, 90)})
    known.count_anew((0, 0, 0), (50, 60, 70), {"x", "y", "z"})
    assert known.mounted.dish_centre_mm == (100, 90)
    assert known.trusted


@pytest.mark.parametrize(
    "said",
    [
        {"plunger_mm": -1},
        {"plunger_mm": "full"},
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

    def do(self, *commands: str) -> list[str]:
        self.sent += commands
        self.transport.write("".join(f"{one}\n" for one in commands).encode())
        said = b""
        while said.splitlines().count(b"ok") < len(commands):
            said += self.transport.read(1.0)
        return said.decode().splitlines()

    def look(self) -> None:
        self.do("M114")


def homed(board: Board) -> tuple[dict[str, Any], Standing]:
    """Home X and Y of a printer by hand; return the answer, and it."""
    standing = Standing(MarlinPrinter(PRINTER_LEVELLING, START, board))
    hands = IdleCommands(standing, Knowledge(PRINTER_LEVELLING))  # type: ignore[arg-type]
    return hands.requests["home"]({"axes": "xy"}), standing


def test_levelling_that_homing_by_hand_switches_on_is_off_again():
    answer, standing = homed(Board(bed_slope=SLOPE, levels_after_homing=True))
    assert "homing switched bed levelling on" in answer["message"]
    assert any("M420 S0" in line for line in standing.do("M503 S0"))


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


def test_heater_that_isnt_there_is_named():
    with pytest.raises(NotAllowed, match="no 'chamber', only of nozzle, bed"):
        check_target(BOTH, "chamber", 30, read_mounted_profiles(MountedParts()), False)


def test_off_is_always_right():
    check_target((), "bed", 0, read_mounted_profiles(MountedParts()), False)
    with pytest.raises(NotAllowed, match="tells of no 'oven'"):
        check_target((), "oven", 0, read_mounted_profiles(MountedParts()), False)
