"""Print simulation: time against a real Marlin, faults found in files."""

import numpy as np
import pytest

from benchmarks.firmware.files import short_curve, short_moves
from firmware_profiles import Printer, load
from firmware_profiles.families import family_of
from firmware_profiles.load import shipped
from gcode.dry_run.run import dry_run
from tests.sim.transcripts import DATA

PROFILE = load(Printer, "marlin_avr")
TWO = PROFILE.model_copy(update={"lines_in_flight": 2})
FRESH = (DATA / "fresh.gcode").read_bytes()
MEASURED_S = 39.366183
"""Mean of the two runs in `avr_duration.txt`, from the first to the last step pulse."""


def codes(run):
    # Most of these files are a few moves, without a lift at their end.
    return [finding.code for finding in run.findings if finding.code != "left_down"]


def only(run):
    assert len(run.findings) == 1, run.findings
    return run.findings[0]


def dry(text, start=(10.0, 10.0, 10.0)):
    return dry_run(text.encode(), PROFILE, start, cold_extrusion=True)


def test_time_and_steps_are_those_of_the_real_printer():
    run = dry_run(FRESH, TWO, (50, 50, 0), cold_extrusion=True)
    assert run.duration_s == pytest.approx(MEASURED_S, rel=1e-3)
    assert codes(run) == []
    assert run.merged_moves == 0
    steps = np.rint(run.executed.end[-1] * [80, 80, 400]).astype(int)
    assert (steps - [4000, 4000, 0]).tolist() == [0, 0, 72]
    assert round(run.executed.plunger_end[-1] * 500) == 3542
    assert len(run.executed) == 486


def test_bounds_come_with_the_line_that_reaches_them():
    run = dry("G1 X20 F600\n; remark\nG1 X5 Y30\nG1 Z11\n")
    assert run.low_mm.tolist() == [5, 10, 10]
    assert run.high_mm.tolist() == [20, 30, 11]
    assert run.low_line.tolist() == [3, 0, 0]
    assert run.high_line.tolist() == [1, 3, 4]


@pytest.mark.parametrize(
    ("text", "code", "line", "value", "limit"),
    [
        ("G1 X20\nG1 X201.5\nG1 X3\n", "outside_x", 2, 201.5, 200),
        ("G1 Y-0.5\n", "outside_y", 1, -0.5, 0),
        ("G1 Z500 F60\n", "outside_z", 1, 500, 200),
        ("G1 X20 F600\nG1 Z11 F600\n", "speed_z", 2, 10, 5),
        ("G1 E1 F1800\n", "speed_e", 1, 30, 25),
        ("G1 X20 F600\nG1 X21 F12\n", "too_slow", 2, 16, 32),
        ("G1 E30 F300\nG92 E0\nG1 E31\n", "plunger_travel", 3, 61, 60),
    ],
)
def test_a_limit_that_is_broken_is_found(text, code, line, value, limit):
    finding = only(dry(text))
    assert (finding.code, finding.line) == (code, line)
    assert finding.value == pytest.approx(value)
    assert finding.limit == limit
    assert f"line {line}" in finding.message
    assert f"{limit:g}" in finding.message


@pytest.mark.parametrize("name", shipped(Printer))
def test_shipped_plungers_may_prime_slowly_where_a_board_has_a_slowest_move(name):
    printer = load(Printer, name)
    if family_of(printer).has_min_speed and not printer.airs:
        run = dry_run(b"M302 P1\nG1 E0.2 F1.4\n", printer, (10.0, 10.0, 10.0))
        assert "too_slow" not in codes(run)


def test_slowest_move_is_its_firmware_s():
    slow = b"G1 X20 F600\nG1 X21 F24\nG1 X22 F3\n"

    def too_slow(name, **changes):
        printer = load(Printer, name).model_copy(update=changes)
        found = dry_run(slow, printer, (10.0, 10.0, 10.0)).findings
        return [(one.line, one.limit, one.message) for one in found if one.code == "too_slow"]

    assert [(line, limit) for line, limit, _ in too_slow("marlin_avr")] == [(3, 32)]
    assert not too_slow("marlin_avr", max_step_rate_hz=1e5)
    assert not too_slow("klipper_bioprinter")
    ((line, limit, message),) = too_slow("jubilee_duet3_syringe", min_speed_mm_s=0.5)
    assert (line, limit) == (2, 0.5)
    assert "min_speed_mm_s" in message
    ((line, limit, message),) = too_slow("two_valves_duet3", min_speed_mm_s=0.1)
    assert (line, limit) == (3, 0.1)
    assert "wider needle" in message


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("G28\n", "homing"),
        ("M73 P1\nM73 P2\n", "unknown_command"),
        ("hello\n", "no_command"),
        ("G2 X20 Y20\n", "bad_arc"),
        ("G2 X20 Y20 I30\n", "bad_arc"),
        ("G2 X12 Y10 I5\n", "bad_arc"),
        ("G2 X11 Y10 R0.2\n", "bad_arc"),
        ("G2 I999999\n", "bad_arc"),
        ("M117 " + "Y10 " * 30 + "\n", "long_line"),
    ],
)
def test_a_line_that_the_firmware_can_not_take_is_found(text, code):
    assert codes(dry(text)) == [code]


def test_cold_extrusion_is_found_and_the_plunger_stays():
    run = dry_run(b"G1 X20 E1 F600\nM302 P1\nG1 X10 E3\n", PROFILE, (10, 10, 10))
    assert codes(run) == ["cold_extrusion"]
    assert run.executed.plunger_end.tolist() == [0, 2]


def test_moves_shorter_than_their_lines_take_are_slowed_by_the_line():
    text = "".join(f"G1 X{10 + 0.1 * k:.1f} F6000\n" for k in range(1, 301)).encode()
    fast_line = PROFILE.model_copy(update={"baud": 2_000_000})
    one = dry_run(text, PROFILE, (10, 10, 10)).duration_s
    two = dry_run(text, TWO, (10, 10, 10)).duration_s
    quick = dry_run(text, fast_line, (10, 10, 10)).duration_s
    assert quick < two < one


@pytest.mark.parametrize(
    ("file", "baud", "in_flight", "turnaround_ms", "measured_s"),
    [
        ("curve", 115_200, 1, 0.21, 9.410),
        ("curve", 115_200, 2, 0.24, 8.450),
        ("curve", 250_000, 1, 0.16, 8.591),
        ("curve", 250_000, 2, 0.28, 8.299),
        ("short", 115_200, 2, 0.23, 7.924),
    ],
)
def test_what_the_wire_starves_takes_as_long_as_on_a_real_marlin(
    file, baud, in_flight, turnaround_ms, measured_s
):
    """Marlin 2.0.9.5 on an ATmega2560 under simavr at 0.1 of real time, by its step edges.

    2026-11-28; ``turnaround_ms`` is the host's as that board saw it.
    """
    changes = {"baud": baud, "lines_in_flight": in_flight, "host_turnaround_s": turnaround_ms / 1e3}
    lines = short_curve(900, 4103, (12.0, 40.0)) if file == "curve" else short_moves(1500).lines
    run = dry_run("\n".join(lines).encode(), PROFILE.model_copy(update=changes))
    assert run.duration_s == pytest.approx(measured_s, rel=0.03)


def test_what_the_wire_starves_is_told_and_what_it_feeds_is_not():
    text = "".join(f"G1 X{10 + 0.15 * k:.2f} F1800\n" for k in range(1, 301)).encode()
    fed = dry_run(text, TWO.model_copy(update={"baud": 2_000_000}), (10, 10, 10))
    late = dry_run(text, PROFILE.model_copy(update={"host_turnaround_s": 0.016}), (10, 10, 10))
    assert late.starved.segments > 80
    assert 0 < late.starved.seconds < late.duration_s
    assert late.starved.line < 20
    assert fed.starved.segments == 0


def test_each_line_costs_its_bytes_both_ways_the_board_and_the_host():
    text = "".join(f"G1 X{10 + 0.1 * k:.1f} F6000\n" for k in range(1, 301)).encode()
    slow = PROFILE.model_copy(update={"host_turnaround_s": 0.03})
    one, longer, later = (
        dry_run(text, slow.model_copy(update=more), (10, 10, 10)).duration_s
        for more in ({}, {"advanced_ok": True}, {"host_turnaround_s": 0.05})
    )
    # the motors begin at the third line, and end a line's time after the last one
    assert later - one == pytest.approx(297 * 0.02, rel=0.02)
    # an ok with N, P and B is 9 bytes and the number's digits more; the divider gives 117,647 Bd
    assert longer - one == pytest.approx(300 * 11.6 * 10 / 117_647, rel=0.1)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("M104 S37", ("ink", 37)),
        ("M109 R30", ("ink", 30)),
        ("M140 S0", ("bath", 0)),
        ("M303 E-1 S60", ("bath", 60)),
        ("M303 S60", ("ink", 60)),
        ("G10 P0 S25", ("ink", 25)),
        ("G10 L2 P1 X5", None),
        ("G10 P1 X3", None),
        ("M568 P0 S21", ("ink", 21)),
        ("M141 S40", ("both", 40)),
        ("M105", None),
        ("SET_HEATER_TEMPERATURE HEATER=heater_bed TARGET=60", ("bath", 60)),
        ("set_heater_temperature heater=extruder target=12.5", ("ink", 12.5)),
        ("SET_HEATER_TEMPERATURE HEATER=lamp TARGET=50", ("both", 50)),
        ("SET_HEATER_TEMPERATURE HEATER=extruder", ("ink", 0)),
    ],
)
def test_every_way_to_set_a_temperature_is_read(line, said):
    printer = load(Printer, "klipper_bioprinter") if "HEATER" in line.upper() else PROFILE
    (found,) = dry_run(f"G90\n{line}\n".encode(), printer).heats or (None,)
    assert (found and (found.part, found.celsius)) == said
    assert found is None or found.line == 2


def test_lines_that_cant_be_read_are_refused_once_a_kind_and_left_out():
    run = dry("G1 X1\nG1 X--5\nG1 Xnan\nG1 X5 A-30 Q7\nG92\nG1 X2\nG1 X1.2.3\n")
    found = {finding.code: finding for finding in run.findings if finding.code != "cold_extrusion"}
    assert {code: (one.line, one.count) for code, one in found.items()} == {
        "bad_number": (2, 3),
        "unknown_axis": (4, 1),
        "ambiguous": (5, 1),
    }
    assert "line 2" in found["bad_number"].message
    assert "3 such lines" in found["bad_number"].message
    assert run.program.line.tolist() == [1, 6]


@pytest.mark.parametrize("number", ["12345678901234567890", "999999", "-999999.999999999"])
@pytest.mark.parametrize("letter", "XYZE")
def test_huge_numbers_are_planned_or_refused(letter, number):
    profile = load(Printer, "generic_marlin")
    run = dry_run(f"G1 X5 F600\nG1 {letter}{number}\n".encode(), profile, (10, 10, 10))
    assert run.findings
