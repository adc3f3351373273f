"""Preflight of jobs for the wrong firmware, or for one without watchdogs."""

from __future__ import annotations

import pytest

from firmware_profiles import Bath, Ink, Printer, Syringe, load
from gcode.dry_run.run import dry_run
from printctl.checks.preflight import (
    Check,
    gcode_checks,
    refuse_failed,
    syringe_checks,
    temperature_checks,
    warnings,
)
from printctl.errors import SafetyError

MARLIN = load(Printer, "generic_marlin")
KLIPPER = load(Printer, "klipper_bioprinter")
DUET = load(Printer, "makergear_m2_duet2")
DUET5 = load(Printer, "ender5_duet3_replistruder5")
START = (50.0, 50.0, 10.0)
BODY = "G21\nG90\nM82\n{cold}G92 {place}E0\nG1 X60 E0.05 F600\nM400\n"


def of(firmware: str) -> Printer:
    return MARLIN.model_copy(update={"firmware": firmware})


def checks_of(
    text: str, printer: Printer, start_mm: tuple[float, ...] = START, of: str = ""
) -> list[Check]:
    """The checks of a job's text, or those whose names begin so."""
    checks = gcode_checks(dry_run(text.encode(), printer, start_mm), printer)
    return [check for check in checks if check.check.startswith(of)]


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
    sort = "lines that are not commands" if "_" in command else "commands unknown"
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
    check = named(checks_of(f"M140 S37\n{body()}{late}", MARLIN), "firmware idle timeout")
    assert check.refuses
    assert "M85 S600" in check.remedy


def test_a_cold_job_without_a_timeout_is_told_of_it() -> None:
    check = named(checks_of(body(), MARLIN), "firmware idle timeout")
    assert not check.passed
    assert not check.refuses
    assert "the host dies" in warnings([check])[0]


def test_dwells_that_follow_each_other_are_one_to_the_firmware() -> None:
    text = f"M85 S60\n{body()}G4 S40\nM105\nG4 S40\nG1 X51 F600\nG4 S30\n"
    check = named(checks_of(text, MARLIN), "firmware idle timeout")
    assert check.refuses
    assert check.limit == 80
    for still in ("G1 F600", "G1 X60", "G1 X60.001", "G1 E0.05", "G0"):
        same = text.replace("M105", still)  # moves no motor: the board died (2026-11-22)
        assert named(checks_of(same, MARLIN), "firmware idle timeout").limit == 80
    apart = text.replace("M105", "G1 X52 F600")
    assert named(checks_of(apart, MARLIN), "firmware idle timeout").passed


def test_a_firmware_without_a_timeout_is_an_alarm_not_silence() -> None:
    checks = checks_of("M140 S37\n" + body(), DUET)
    check = named(checks, "firmware idle timeout")
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
    assert "exceed 0.0835 mm²" in told


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
    check = named(checks_of(body(), printer), "safe-state commands")
    assert check.passed == known
    assert known or command in check.remedy


@pytest.mark.parametrize(
    "command", ["G1 Z10", "M106 S0\nG1 Z0", "M106 S0 ; off", "", "FORCE_MOVE STEPPER=z"]
)
def test_a_safe_state_that_could_move_is_refused(command: str) -> None:
    values = MARLIN.model_dump() | {"safe_state_off": [command]}
    with pytest.raises(ValueError, match="safe_state_off"):
        Printer.model_validate(values)


UNPOWERED = "motors without power"


@pytest.mark.parametrize(
    ("printer", "off"),
    [
        *((printer, off) for printer in (MARLIN, DUET) for off in ("M84", "M18", "M84 X")),
        # A real Klipper refuses the next move, the way out of the bath too (2026-11-22).
        *((KLIPPER, off) for off in ("M84", "M18")),
        # A dwell, a pause or a wait for heat may be longer; the link sets the time itself.
        *((printer, off) for printer in (MARLIN, DUET)
          for off in ("M84 S1", "M18 S1", "M84 S600", "M84 S1 X")),
    ],
)  # fmt: skip
def test_motors_that_lose_their_power_before_the_last_move_are_refused(printer, off):
    cold = "M302 P1\n" if printer is not KLIPPER else ""
    found = named(checks_of(body(cold) + f"{off}\nG1 X50\n", printer), UNPOWERED)
    assert (found.refuses, found.passed) == (True, False)
    assert found.place == ("line 8" if cold else "line 7")
    assert checks_of(body(cold) + f"G1 X50\n{off}\n", printer, of=UNPOWERED) == []


# --- digital outputs set by a controller's program file: checks
A3200 = load(Printer, "aerotech_pneumatic")
FILE = "$DO[0].X=0\nG71\nG76\nG90\nVELOCITY ON\nG92 X60 Y70 Z30\n{}\nG1 X61 F5\n"


def outputs(line: str, printer: Printer) -> Check:
    return named(checks_of(FILE.format(line), printer, (60.0, 70.0, 30.0)), "outputs set")


@pytest.mark.parametrize("line", ["$DO[0].X=1", "$DO[0].X = 0", "$do[0].x=0", ""])
def test_the_profile_s_valve_may_be_switched(line):
    assert outputs(line, A3200).passed


@pytest.mark.parametrize(
    "line",
    ["$DO[1].X=1", "$DO[1].X=0", "$DO[0].Y=1", "$DO[0].X=2", "$DO[0].X=(1)", "$DO = 5"]
    + ["DigitalOutputSet(X, 1, 1)"],
)
def test_any_other_output_is_refused_by_its_line(line):
    """A lamp, a heater or a brake may hang there."""
    found = outputs(line, A3200)
    assert (found.refuses, found.place) == (True, "line 7")
    assert "remove the line" in found.remedy
    assert "$DO[0].X=1" in found.remedy


# --- tip positions declared in a job: once, before the first move
START_PLACE_CHECKS = (100, 100, 20)


def told_anew(printer, *lines, start=START_PLACE_CHECKS):
    job = "\n".join(["G21", "G90", "M82", *lines, "M400", ""])
    return [one for one in checks_of(job, printer, start) if "redefined" in one.check]


PLACED = "G92 X100 Y100 Z20 E0"
NAMED = "SET_KINEMATIC_POSITION X=100 Y=100 Z=20"


@pytest.mark.parametrize(
    ("printer", "lines", "told"),
    [
        (MARLIN, [PLACED, "G92 Z100", "G1 Z101 F200", "G92 Z20"], ("Z", 100, 20)),
        (MARLIN, [PLACED, "G1 Z21 F200", "G92 Z20"], ("Z", 20, 21)),
        (MARLIN, [PLACED, "G1 X101 F200", "G92 X0"], ("X", 0, 101)),
        (MARLIN, ["G1 X101 F200", "G92 X0"], ("X", 0, 101)),
        (KLIPPER, [NAMED, "G1 Z21 F200", "SET_KINEMATIC_POSITION Z=100"], ("Z", 100, 21)),
        (KLIPPER, [NAMED, "G92 Z5", "G1 Z6 F200"], ("Z", 5, 20)),
        (KLIPPER, ["G92 X30", "SET_KINEMATIC_POSITION X=30", "G1 X32 F200"], ("X", 30, 100)),
        (DUET5, [PLACED, "G92 Z0", "G1 Z1 F200"], ("Z", 0, 20)),
    ],
)
def test_another_place_told_later_is_a_failed_row(printer, lines, told):
    (row,) = told_anew(printer, *lines)
    axis, value, stands = told
    assert row.refuses
    assert (row.check, row.value, row.limit) == (
        f"{axis} redefined after the first move",
        value,
        stands,
    )


@pytest.mark.parametrize(
    ("printer", "lines"),
    [
        (MARLIN, [PLACED, "G1 X101 E1 F200", "G92 E0", "G1 X102 E1"]),
        (MARLIN, [PLACED, "G1 X101 Z22 F200", "G92 X101 Z22"]),
        (KLIPPER, [NAMED, "G92 E0", "G1 X101 F200", "SET_KINEMATIC_POSITION X=101"]),
        (DUET5, ["G92 X100", "G92 Y100", "G92 Z20", "G1 X101 F200"]),
    ],
)
def test_the_same_place_and_the_plunger_s_count_pass(printer, lines):
    assert told_anew(printer, *lines) == []
    moved = (0, 0, 0)
    assert told_anew(printer, *lines, start=moved) == []


# --- temperature waits that no heater can satisfy


def waits(printer, *lines):
    job = "\n".join(["G21", "G90", "M82", "G92 E0", *lines, "G1 X101 F300", ""])
    return checks_of(job, printer, (100, 100, 10), "wait for a temperature")


COLD = ["M109 R5", "M190 R2", "M191 S5", "M191 R25", "M109 R29.9"]


@pytest.mark.parametrize(
    ("printer", "lines"),
    [
        *((printer, [line]) for printer in (MARLIN, DUET5) for line in COLD),
        (KLIPPER, ["TEMPERATURE_WAIT SENSOR=extruder MAXIMUM=5"]),
        (KLIPPER, ["M104 S0", "TEMPERATURE_WAIT SENSOR=extruder MINIMUM=9"]),
        (KLIPPER, ["M104 S8", "TEMPERATURE_WAIT SENSOR=extruder MINIMUM=9"]),
        (KLIPPER, ["TEMPERATURE_WAIT SENSOR=heater_bed MINIMUM=35"]),
        (KLIPPER, ["M140 S36", "TEMPERATURE_WAIT SENSOR=heater_bed MAXIMUM=35"]),
        (KLIPPER, ["M109 S5"]),
        (KLIPPER, ["M190 S25"]),
    ],
)
def test_a_wait_that_never_ends_is_a_failed_row_with_its_line(printer, lines):
    (row,) = waits(printer, *lines)
    assert row.refuses
    assert row.place == f"line {4 + len(lines)}"
    if printer is not KLIPPER:
        assert (row.value, row.limit) == (float(lines[0][6:]), 30)
        assert "room (15 to 30" in row.remedy


@pytest.mark.parametrize(
    ("printer", "lines"),
    [
        (MARLIN, ["M109 S5"]),
        (MARLIN, ["M109 R37"]),
        (MARLIN, ["M190 S37"]),
        (MARLIN, ["M104 S5"]),
        (KLIPPER, ["M190 S37", "TEMPERATURE_WAIT SENSOR=heater_bed MINIMUM=36 MAXIMUM=38"]),
        (KLIPPER, ["SET_HEATER_TEMPERATURE HEATER=extruder TARGET=9",
                   "TEMPERATURE_WAIT SENSOR=extruder MINIMUM=9"]),
        (KLIPPER, ["M109 S0"]),
    ],
)  # fmt: skip
def test_a_wait_that_heaters_end_passes(printer, lines):
    assert waits(printer, *lines) == []


# --- heater commands in a job: of another head, without a target, beyond the limit
PRINTERS = {
    "marlin": MARLIN,
    "prusa": MARLIN.model_copy(update={"firmware": "prusa"}),
    "reprapfirmware": DUET5,
    "klipper": KLIPPER,
}
INK, BATH = load(Ink, "collagen_fresh"), load(Bath, "gelatin_support")
WARM = (INK.temperature_c.low + INK.temperature_c.high) / 2
CODES = ("M104", "M109", "M140", "M190", "M141", "M191")
ODD = (
    "", f"T9 S{WARM:g}", f"S{WARM:g} T1", f"T0.5 S{WARM:g}", f"T-1 S{WARM:g}", "T9", "S", "S999",
    "R999", "S-5", f"S{WARM:g} R999", f"P9 S{WARM:g}", f"H9 S{WARM:g}",
)  # fmt: skip
CODED = [f"{code} {words}".strip() for code in CODES for words in ODD]
OTHERS = [
    "G10 P0 S999", "G10 S999 R999", f"G10 P9 S{WARM:g}", "M568 P0 S999", f"M568 P9 S{WARM:g}",
    "M303 E0 S999", "M116 P9", "M143 S999", "M144", "M145 S0 H999 B999",
]  # fmt: skip
NAMED_HEAT_COMMANDS = [
    *(
        f"SET_HEATER_TEMPERATURE {words}"
        for words in (
            "HEATER=extruder", "HEATER=extruder TARGET=999", "HEATER=extruder TARGET=-5",
            "HEATER=extruder TARGET=nan", "HEATER=extruder TARGET=inf",
            f"HEATER=extruder9 TARGET={WARM:g}", f"HEATER=extruder1 TARGET={WARM:g}",
            f"HEATER=chamber TARGET={WARM:g}", f"SENSOR=extruder TARGET={WARM:g}",
            f"TARGET={WARM:g}", f"HEATER=extruder MINIMUM={WARM:g}",
        )
    ),
    *(
        f"TEMPERATURE_WAIT {words}"
        for words in (
            "SENSOR=extruder", "SENSOR=extruder MINIMUM=999", "SENSOR=extruder MAXIMUM=-50",
            "SENSOR=heater_bed MINIMUM=999", "SENSOR=extruder MINIMUM=inf",
            "SENSOR=extruder MAXIMUM=inf", "SENSOR=extruder MINIMUM=nan",
            f"SENSOR=extruder MINIMUM={WARM:g} MAXIMUM={WARM - 1:g}",
            f"SENSOR=extruder9 MINIMUM={WARM:g}", f"HEATER=extruder MINIMUM={WARM:g}",
            f"MINIMUM={WARM:g}",
        )
    ),
]  # fmt: skip
FINE = {
    "klipper": [
        f"SET_HEATER_TEMPERATURE HEATER=extruder TARGET={WARM:g}",
        "SET_HEATER_TEMPERATURE HEATER=heater_bed TARGET=0",
        "TEMPERATURE_WAIT SENSOR=extruder MAXIMUM=30",
        f"M104 S{WARM:g}\nTEMPERATURE_WAIT SENSOR=extruder MINIMUM={WARM:g} MAXIMUM=30",
    ]
}


def failed_rows(family: str, line: str):
    printer = PRINTERS[family]
    job = f"G21\nG90\nM82\nG92 E0\n{line}\nG1 X101 F300\n".encode()
    run = dry_run(job, printer, (100, 100, 10))
    rows = [*gcode_checks(run, printer), *temperature_checks(run, INK, BATH)]
    return [row for row in rows if row.refuses and "idle timeout" not in row.check]


@pytest.mark.parametrize(
    ("family", "line"),
    [(family, line) for line in CODED + OTHERS for family in PRINTERS]
    + [("klipper", line) for line in NAMED_HEAT_COMMANDS],
)
def test_odd_heat_is_a_failed_row_that_names_its_line(family, line):
    rows = failed_rows(family, line)
    assert rows, line
    assert any("line 5" in f"{row.place} {row.remedy}" for row in rows)


@pytest.mark.parametrize("family", PRINTERS)
def test_heat_that_ink_and_machine_bear_passes(family):
    fine = [f"M104 S{WARM:g}", f"M104 T0 S{WARM:g}", "M104 S0", "M140 S0", f"M140 S{WARM:g}"]
    for line in (*fine, *FINE.get(family, ())):
        assert failed_rows(family, line) == [], line


def test_a_heater_set_by_klipper_s_own_command_heats() -> None:
    text = "SET_HEATER_TEMPERATURE HEATER=heater_bed TARGET=30\n" + body("")
    assert named(checks_of(text, KLIPPER), "firmware idle timeout").refuses
