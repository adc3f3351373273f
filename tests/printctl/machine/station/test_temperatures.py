"""Temperatures by firmware, and limits of mounted materials."""

from __future__ import annotations

import pytest

from firmware_profiles import Printer, load
from printctl.checks.gate import Bounds, NotAllowed, PrinterSituation, check_heat
from printctl.machine.link.temperatures import Temperature, parse_temperatures, target_command
from printctl.machine.station.known_state import heat_limits
from printctl.machine.station.mounted_profiles import read_mounted_profiles
from printctl.machine.station.status import MountedParts

PRINTER = load(Printer, "generic_marlin")


def check_target(known, name, celsius, profiles, part_in_dish):
    told = tuple(one.name for one in known)
    limits = heat_limits(profiles, part_in_dish)
    check_heat(PrinterSituation(Bounds(PRINTER), heat=limits, heaters=told), name, celsius)


BOTH = (Temperature("nozzle", 21.0, 0.0), Temperature("bed", 21.0, 0.0))


@pytest.mark.parametrize(
    ("reply", "names"),
    [
        (b"ok T:23.40 /37.00 B:21.00 /0.00 @:0 B@:0", ["nozzle", "bed"]),
        (b"T:20.0 /0.0 B:20 /0 C:5.0 /0.0 T0:20.0 /0.0 T1:31.5 /0 @:0 B@:0",
         ["nozzle", "bed", "chamber", "nozzle 1"]),
        (b"ok T0:20.0 /0.0 B:-1.5 /0.0", ["nozzle", "bed"]),
        (b"ok", []),
        (b"echo:busy: processing", []),
    ],
)  # fmt: skip
def test_heaters_are_found_by_name(reply, names):
    assert [one.name for one in parse_temperatures((reply,))] == names


def test_reading_and_target():
    nozzle, bed = parse_temperatures((b"T:23.40 /37.00 B:-1.5 /0.00 @:0",))
    assert (nozzle.now_c, nozzle.target_c) == (23.4, 37.0)
    assert bed.now_c == -1.5


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


def test_commands_set_and_dont_wait():
    assert target_command("bed", 37) == "M140 S37"
    assert target_command("nozzle 1", 4.5) == "M104 T1 S4.5"


def test_off_is_always_right():
    check_target((), "bed", 0, read_mounted_profiles(MountedParts()), False)
    with pytest.raises(NotAllowed, match="tells of no 'oven'"):
        check_target((), "oven", 0, read_mounted_profiles(MountedParts()), False)
