"""Preflight of jobs for the wrong firmware, or for one without watchdogs."""

from __future__ import annotations

import pytest

from firmware_profiles import Printer, Syringe, load
from printctl.checks.preflight import Check, gcode_checks, refuse_failed, syringe_checks, warnings
from printctl.errors import SafetyError
from sim.gcode.dry_run.run import dry_run

MARLIN = load(Printer, "generic_marlin")
KLIPPER = load(Printer, "klipper_bioprinter")
DUET = load(Printer, "makergear_m2_duet2")
START = (50.0, 50.0, 10.0)
BODY = "G21\nG90\nM82\n{cold}G92 {place}E0\nG1 X60 E0.05 F600\nM400\n"


def of(firmware: str) -> Printer:
    return MARLIN.model_copy(update={"firmware": firmware})


def checks_of(text: str, printer: Printer) -> list[Check]:
    return gcode_checks(dry_run(text.encode(), printer, START), printer)


def named(checks: list[Check], name: str) -> Check:
    found = [check for check in checks if check.check.startswith(name)]
    assert len(found) == 1, [check.check for check in checks]
    return found[0]


def body(cold: str = "M302 P1\n", place: str = "X50 Y50 Z10 ") -> str:
    return BODY.format(cold=cold, place=place)


@pytest.mark.parametrize(
    ("firmware", "command"),
    [
        ("marlin", "SET_IDLE_TIMEOUT TIMEOUT=600"),
        ("reprapfirmware", "M113 S1"),
        ("klipper", "M85 S600"),
        ("klipper", "M302 P1"),
        ("prusa", "M154 S1"),
    ],
)
def test_a_command_of_another_firmware_is_refused_with_its_line(
    firmware: str, command: str
) -> None:
    checks = checks_of(body("") + command + "\n", of(firmware))
    sort = "lines that are no command" if "_" in command else "commands unknown"
    check = named(checks, sort)
    assert check.refuses
    assert check.place == "line 7"
    with pytest.raises(SafetyError, match="line 7"):
        refuse_failed([check])


def test_a_command_that_the_profile_names_is_known() -> None:
    printer = KLIPPER.model_copy(update={"extra_commands": ("M600", "PRIME_NOZZLE")})
    checks = checks_of(body("") + "M600\nPRIME_NOZZLE X=1\nprime_nozzle\n", printer)
    assert named(checks, "commands unknown").passed
    assert not named(checks_of(body("") + "PRIME_NOZZLE\n", KLIPPER), "commands unknown").passed


@pytest.mark.parametrize("late", ["", "M85 S600\n", "M85 S0\n"])
def test_a_job_that_heats_without_a_timeout_is_refused(late: str) -> None:
    check = named(checks_of(f"M140 S37\n{body()}{late}", MARLIN), "the firmware's own switch-off")
    assert check.refuses
    assert "M85 S600" in check.remedy


def test_a_timeout_that_the_job_takes_back_is_none() -> None:
    text = f"M85 S600\nM140 S25\n{body()}M85 S0\nG1 X50 F600\n"
    check = named(checks_of(text, MARLIN), "the firmware's own switch-off")
    assert check.refuses
    assert "line 10" in check.place
    asked = text.replace("M85 S0", "M85")  # a question takes nothing back
    assert named(checks_of(asked, MARLIN), "the firmware's own switch-off").passed


def test_a_heater_set_by_klipper_s_own_command_heats() -> None:
    text = "SET_HEATER_TEMPERATURE HEATER=heater_bed TARGET=30\n" + body("")
    assert named(checks_of(text, KLIPPER), "the firmware's own switch-off").refuses


def test_a_cold_job_without_a_timeout_is_told_of_it() -> None:
    check = named(checks_of(body(), MARLIN), "the firmware's own switch-off")
    assert not check.passed
    assert not check.refuses
    assert "dead host" in warnings([check])[0]


def test_dwells_that_follow_each_other_are_one_to_the_firmware() -> None:
    text = f"M85 S60\n{body()}G4 S40\nM105\nG4 S40\nG1 X51 F600\nG4 S30\n"
    check = named(checks_of(text, MARLIN), "the firmware's own switch-off")
    assert check.refuses
    assert check.limit == 80
    for still in ("G1 F600", "G1 X60", "G1 X60.001", "G1 E0.05", "G0"):
        same = text.replace("M105", still)  # moves no motor: the board died (2026-11-22)
        assert named(checks_of(same, MARLIN), "the firmware's own switch-off").limit == 80
    apart = text.replace("M105", "G1 X52 F600")
    assert named(checks_of(apart, MARLIN), "the firmware's own switch-off").passed


def test_a_firmware_without_a_timeout_is_an_alarm_not_silence() -> None:
    checks = checks_of("M140 S37\n" + body(), DUET)
    check = named(checks, "the firmware's own switch-off")
    assert not check.passed
    assert not check.refuses
    assert DUET.firmware in check.remedy


@pytest.mark.parametrize(
    ("firmware", "cold", "allowed"),
    [
        ("marlin", "M302 P1\n", True),
        ("marlin", "M302 S0\n", True),
        ("marlin", "M302 P1\nM302 P0\n", False),
        ("marlin", "M302 S170\n", False),
        ("marlin", "M302\n", False),
        ("prusa", "M302 S0\n", True),
        ("prusa", "M302\n", True),
        ("reprapfirmware", "M302 P1\n", True),
        ("reprapfirmware", "M302 S0\n", False),
        ("klipper", "", False),
    ],
)
def test_cold_plunger_moves_are_refused_unless_the_firmware_lets_them(
    firmware: str, cold: str, allowed: bool
) -> None:
    check = named(checks_of(body(cold), of(firmware)), "plunger moves")
    assert check.passed == allowed
    assert allowed or check.place == f"line {5 + cold.count(chr(10))}"


def test_klipper_s_configuration_is_asked_for() -> None:
    run = dry_run(body("").encode(), KLIPPER, START)
    checks = [
        *gcode_checks(run, KLIPPER),
        *syringe_checks(run, KLIPPER, load(Syringe, "hamilton_1ml")),
    ]
    assert named(checks, "plunger moves").passed
    told = " ".join(warnings(checks))
    assert "min_extrude_temp" in told
    # 0.05 mm of a 4.61 mm bore on 10 mm of way.
    assert "above 0.0835 mm²" in told


def test_an_offset_that_shifts_places_is_refused_and_one_taken_back_isn_t() -> None:
    begin = "SET_KINEMATIC_POSITION X=50 Y=50 Z=10\n"
    for line in ("SET_GCODE_OFFSET Z=0.2", "set_gcode_offset X=0 MOVE=1",
                 "SET_GCODE_OFFSET Z_ADJUST=-1"):  # fmt: skip
        checks = checks_of(f"{begin}{line}\n{body('')}", KLIPPER)
        assert named(checks, "offset").refuses
        assert named(checks, "offset").place == "line 2"
    checks = checks_of(f"{begin}SET_GCODE_OFFSET X=0 Y=0 Z=0\n{body('')}", KLIPPER)
    assert not [check for check in checks if check.check == "offset"]


@pytest.mark.parametrize(
    ("printer", "command", "known"),
    [
        (MARLIN, "M106 S0", True),
        (MARLIN, "M42 P4 S0", False),
        (DUET, "M42 P4 S0", True),
        (KLIPPER, "SET_PIN PIN=uv VALUE=0", True),
        (KLIPPER, "UV_OFF", False),
        (MARLIN, "SET_PIN PIN=uv VALUE=0", False),
    ],
)
def test_the_safe_state_must_be_known_to_the_firmware(
    printer: Printer, command: str, known: bool
) -> None:
    printer = Printer.model_validate(printer.model_dump() | {"safe_state_off": [command]})
    check = named(checks_of(body(), printer), "commands of the safe state")
    assert check.passed == known
    assert known or command in check.remedy


@pytest.mark.parametrize(
    "command", ["G1 Z10", "M106 S0\nG1 Z0", "M106 S0 ; off", "", "FORCE_MOVE STEPPER=z"]
)
def test_a_safe_state_that_could_move_is_refused(command: str) -> None:
    values = MARLIN.model_dump() | {"safe_state_off": [command]}
    with pytest.raises(ValueError, match="safe_state_off"):
        Printer.model_validate(values)


@pytest.mark.parametrize("printer", [MARLIN, KLIPPER, DUET], ids=["marlin", "klipper", "duet"])
@pytest.mark.parametrize("off", ["M84", "M18", "M84 X"])
def test_motors_that_lose_their_power_before_the_last_move_are_refused(printer, off):
    """A real Klipper refuses the next move, the way out of the bath too (2026-11-22)."""
    cold = "M302 P1\n" if printer is not KLIPPER else ""
    if printer is KLIPPER and off != "M84":
        off = "M18"
    name = "motors without power"
    found = named(checks_of(body(cold) + f"{off}\nG1 X50\n", printer), name)
    assert (found.passed, found.place) == (False, "line 8" if cold else "line 7")
    rest = [check.check for check in checks_of(body(cold) + f"G1 X50\n{off}\n", printer)]
    assert not [check for check in rest if check.startswith(name)]


@pytest.mark.parametrize("printer", [MARLIN, DUET], ids=["marlin", "duet"])
@pytest.mark.parametrize("off", ["M84 S1", "M18 S1", "M84 S600", "M84 S1 X"])
def test_a_time_after_which_motors_lose_their_power_is_refused_before_the_last_move(printer, off):
    """A dwell, a pause or a wait for heat may be longer; the link sets the time itself."""
    found = named(checks_of(body() + f"{off}\nG1 X50\n", printer), "motors without power")
    assert (found.refuses, found.place) == (True, "line 8")
    rest = [check.check for check in checks_of(body() + f"G1 X50\n{off}\n", printer)]
    assert not [check for check in rest if check.startswith("motors without power")]
