"""G-code gate: allowed and refused codes, by origin and printer state."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from design.toolpath.gcode.numbers import dialect_of
from firmware_profiles import Dish, Needle, Printer, load
from printctl.checks.gate import (
    AllowedLine,
    Bounds,
    LineAction,
    LineOrigin,
    Phase,
    PrinterSituation,
    Refusal,
    judge,
    judge_stored_line,
)

MARLIN = load(Printer, "generic_marlin")
KLIPPER = load(Printer, "klipper_bioprinter")
DUET = load(Printer, "makergear_m2_duet2")
PNEUMATIC = load(Printer, "pneumatic_marlin")
DISH = Bounds(
    MARLIN,
    trusted=True,
    needle=load(Needle, "25g"),
    dish=load(Dish, "petri_60mm"),
    centre_mm=(100.0, 100.0),
    floor_mm=2.0,
)
AT = (100.0, 100.0, 50.0)
STANDING = PrinterSituation(
    Bounds(MARLIN, trusted=True), Phase.STANDING, AT, heaters=("nozzle", "bed")
)
PRINTING = PrinterSituation(DISH, Phase.PRINTING, AT)
PAUSED = PrinterSituation(DISH, Phase.PAUSED, AT, plunger_mm=1.0)
MOMENTS = (STANDING, PRINTING, PAUSED)


def allowed(
    typed: str, known: PrinterSituation = STANDING, door: LineOrigin = LineOrigin.CONSOLE
) -> AllowedLine:
    verdict = judge(typed, door, known)
    assert isinstance(verdict, AllowedLine), verdict
    return verdict


def refusal(
    typed: str, known: PrinterSituation = STANDING, door: LineOrigin = LineOrigin.CONSOLE
) -> str:
    verdict = judge(typed, door, known)
    assert isinstance(verdict, Refusal), verdict
    return verdict.message


@pytest.mark.parametrize(
    "typed",
    ["G 1 Z-50", "g1z-50", "(x)G1 Z-50", "G1 (x) Z-50", "g01 z -50", "G1Z-50;up", "G1\tZ-50"]
    + ["N5 G1 Z-50*12", "N5G1Z-50", "G1 X1 G1 Z-50", "M114\nG1 Z-50", "M114\rG1 Z-50", "G1 Z-٥٠"]
    + ["G1 Z-5e1", "G1 Z--50", "G1 Znan", "G1 Z-inf", "G1 Z-50.0.0", "G0 F1e9", "G0 X1 F9e9", "G53"]
    + ["G91", "G92 Z100", "G92.1", "G28.1", "M104 S1e9", "M104.1 S30", "M104 S250", "T1", "T?"]
    + ['M118 "ok"', "M118 ok", "M28", "M23 a.g", "M24", "M98", "M999", "M112", "M410", "M108"]
    + ["M110 N1", "M83", "M84", "M18", "M17", "M92 X1", "M201 X9", "M203 X9", "M204 P9", "M205 X9"]
    + ["M206 X1", "M211 S0", "M218 T1 X1", "M220 S50", "M221 S50", "M301 P1", "M302 P0", "M304 P1"]
    + ["M350 X16", "M428", "M500", "M501", "M502", "M504", "M85 S0", "M113 S0", "M111 S8"]
    + ["M155 S0", "M149 F", "M303 S200", "M109 S30", "M0", "M1", "G4 S9999", "", ";G28", "M900 K1"]
    + ["M106 S1e9", "M106 P0", "M876 S0", "G29", "G30", "G38.2 Z-5", "G10", "G5 X1"]
    + ["M600", "é", "x" * 1000],
)  # fmt: skip
def test_nothing_that_moves_beyond_heats_beyond_or_sets_passes_a_console(typed):
    for known in MOMENTS:
        assert refusal(typed, known)


@pytest.mark.parametrize("door", LineOrigin)
@pytest.mark.parametrize(
    "typed",
    ["M117 {1} M104 S250", "M117 {1} G1 Z-50 F6000", "M117 (a) {1} M500", "M117 {}", "M117 {1}{2}"]
    + ['M117 "{1}" M500', "M118 {1} M500", 'echo {1} M500', 'M291 P{1} M500', "M105 {1} M500"],
)  # fmt: skip
def test_no_command_hides_behind_a_text_that_the_board_works_out(typed, door):
    assert refusal(typed, PrinterSituation(Bounds(DUET, trusted=True), Phase.STANDING, AT), door)


@pytest.mark.parametrize("typed", ["G1 X0 Y0 Z2 F6000", "G1 Z50", "G0 X100", "G28", "M400"])
def test_nothing_moves_by_hand_while_a_print_goes_on(typed):
    assert refusal(typed, PRINTING)


def test_through_the_dish_is_refused_with_place_and_limit():
    assert "of the wall of" in refusal("G1 X0 Y0 Z2", PAUSED)
    assert "below the dish's floor" in refusal("G1 Z1", PAUSED)


@pytest.mark.parametrize(
    ("typed", "text"),
    [
        ("m 105", "M105"),
        ("M0114", "M114"),
        ("m106 p0 s128", "M106 P0 S128"),
        ("M107", "M107"),
        ("M104S37", "M104 S37"),
        ("M140 S0", "M140 S0"),
        ("M503 ; settings", "M503"),
        ("M92", "M92"),
        ("M220", "M220"),
    ],
)
def test_questions_fans_and_heat_within_limits_pass_in_every_state(typed, text):
    for known in MOMENTS:
        assert allowed(typed, known).text == text


def test_a_move_of_a_standing_tip_goes_by_its_limits():
    move = allowed("G 1 X 110 F600")
    assert (move.act, move.target, move.speed_mm_s) == (LineAction.MOVE, (110.0, 100.0, 50.0), 10.0)
    assert "outside 0 to 200 mm" in refusal("G1 X900")
    assert "exceeds 5 mm/s" in refusal("G1 Z60 F6000")
    assert "isn't known to be right" in refusal(
        "G1 X110", PrinterSituation(Bounds(MARLIN), position=AT)
    )


def test_the_firmwares_own_commands_with_names_are_listed_one_by_one():
    known = PrinterSituation(Bounds(KLIPPER, trusted=True), Phase.STANDING, AT)
    assert allowed("status", known).text == "STATUS"
    for typed in (
        "LOAD_INK", "SET_PIN PIN=valve VALUE=1", "SAVE_CONFIG", "FIRMWARE_RESTART", "RESTART",
        "SET_GCODE_OFFSET Z=-5 MOVE=1", "SET_KINEMATIC_POSITION Z=100", "SAVE_GCODE_STATE",
        "SET_IDLE_TIMEOUT TIMEOUT=1", "FORCE_MOVE STEPPER=stepper_z DISTANCE=-50 VELOCITY=5",
        "SET_HEATER_TEMPERATURE HEATER=extruder TARGET=250", "RESTORE_GCODE_STATE NAME=a MOVE=1",
        "SET_HEATER_TEMPERATURE HEATER=extruder TARGET=nan", "SDCARD_PRINT_FILE FILENAME=a.g",
    ):  # fmt: skip
        assert refusal(typed, known)


def test_a_valve_is_opened_by_a_print_alone():
    known = PrinterSituation(Bounds(PNEUMATIC, trusted=True), position=AT)
    opens = PNEUMATIC.pneumatic.opens if PNEUMATIC.pneumatic else ""
    assert "a print alone" in refusal(opens, known)
    assert allowed(opens, PrinterSituation.of_job(PNEUMATIC), LineOrigin.JOB)


@pytest.mark.parametrize("printer", [MARLIN, KLIPPER, DUET, PNEUMATIC])
def test_every_line_of_our_own_header_passes_the_jobs_door(printer):
    dialect = dialect_of(printer)
    for line in [*dialect.header(printer, ("1", "2", "3")), *dialect.footer(), dialect.dwell(0.5)]:
        assert allowed(line, PrinterSituation.of_job(printer), LineOrigin.JOB)


@pytest.mark.parametrize(
    "line",
    ["M500", "M502", "M92 X1", "M206 X1", "M211 S0", "M220 S50", "M221 S95", "M301 P1"]
    + ["M204 P99999", "M203 Z500", "M200 D1.75", "M900 K0.5", "M118 ok", "M113 S0", "G91", "M83"]
    + ["M218 T1 X5", "M85 S600 X1", "M106 S300", "M155 S1", "SET_PIN PIN=a", "M17 S1e9"],
)  # fmt: skip
def test_a_job_doesnt_change_the_firmware(line):
    assert refusal(line, PrinterSituation.of_job(MARLIN), LineOrigin.JOB)


def test_a_job_may_set_what_is_undone_at_its_end():
    assert allowed("M204 P1000", PrinterSituation.of_job(MARLIN), LineOrigin.JOB).undo == ("M204",)
    assert allowed("M302 P1", PrinterSituation.of_job(MARLIN), LineOrigin.JOB).undo == ("M302",)


@pytest.mark.parametrize("line", ["M302 P-1", "M302 P2", "M302 P0.5", "M302 S-1", "M302 S9999"])
@pytest.mark.parametrize("printer", [MARLIN, DUET])
def test_cold_extrusion_is_set_by_values_that_each_firmware_reads_alike(line, printer):
    assert refusal(line, PrinterSituation.of_job(printer), LineOrigin.JOB)
    for plain in ("M302 P0", "M302 P1", "M302 S0", "M302 S170 P1"):
        assert allowed(plain, PrinterSituation.of_job(printer), LineOrigin.JOB)


PLANNED = [
    "M204 P{a:g} T{a:g}", "M204 S{a:g}", "M201 X{x:g}", "M203 X{v:g}", "M205 B{b:g}",
]  # fmt: skip


@pytest.mark.parametrize("line", PLANNED)
def test_a_setting_with_which_the_dry_run_plans_passes(line):
    for printer in (MARLIN, KLIPPER, DUET, PNEUMATIC):
        per = 60 if printer is DUET else 1
        text = line.format(
            a=printer.acceleration_mm_s2,
            x=printer.max_acceleration_mm_s2.x,
            v=printer.max_speed_mm_s.x * per,
            b=printer.min_segment_time_s * 1e6,
        )
        assert allowed(text, PrinterSituation.of_job(printer), LineOrigin.JOB)


@pytest.mark.parametrize("printer", [MARLIN, KLIPPER, DUET, PNEUMATIC])
@pytest.mark.parametrize(
    "line",
    ["M204 P60 T60", "M204 S1", "M204 P0", "M204 T99999", "M201 X1", "M201 X0", "M203 X1"]
    + ["M203 E0", "M205 J0.3", "M205 X5", "M205 S100", "M205 B0.5", "M566 X900"]
    + ["SET_VELOCITY_LIMIT ACCEL=1", "SET_VELOCITY_LIMIT VELOCITY=50", "M205 T5"],
)  # fmt: skip
def test_a_setting_with_which_the_dry_run_doesnt_plan_is_refused(printer, line):
    """M204 P60 T60 let a job pass as 4 s that took 11 s."""
    assert refusal(line, PrinterSituation.of_job(printer), LineOrigin.JOB)


def test_a_junction_deviation_is_refused_even_the_profile_s():
    """M503 tells two decimals: 0.0149 became 0.01 at the job's end (real board, 2026-11-22)."""
    line = f"M205 J{MARLIN.junction_deviation_mm:g}"
    assert "two decimals" in refusal(line, PrinterSituation.of_job(MARLIN), LineOrigin.JOB)


def test_another_acceleration_is_refused_with_the_profile_s_key():
    told = refusal("M204 P60 T60", PrinterSituation.of_job(MARLIN), LineOrigin.JOB)
    assert "P60 isn't P1000 (acceleration_mm_s2 of Generic Marlin" in told


@pytest.mark.parametrize(
    ("printer", "line"),
    [(MARLIN, f"M85 S{seconds}") for seconds in ("3601", "999999", "-5")]
    + [(KLIPPER, f"SET_IDLE_TIMEOUT TIMEOUT={seconds}") for seconds in
       ("99999999", "-5", "abc", "nan", "inf")]
    + [(KLIPPER, "SET_IDLE_TIMEOUT FOO=5"), (KLIPPER, "SET_IDLE_TIMEOUT TIMEOUT=5 FOO=5")],
)  # fmt: skip
def test_a_switch_off_that_never_comes_is_refused(printer, line):
    assert "from 60 to 3600 s" in refusal(line, PrinterSituation.of_job(printer), LineOrigin.JOB)


@pytest.mark.parametrize(
    ("printer", "line"),
    [(MARLIN, f"M85 S{seconds}") for seconds in ("0.5", "1", "59")]
    + [(KLIPPER, f"SET_IDLE_TIMEOUT TIMEOUT={seconds}") for seconds in ("0", "0.001", "59.9")],
)  # fmt: skip
def test_a_switch_off_that_strikes_in_a_pause_is_refused_with_what_it_must_be(printer, line):
    """M85 S1 killed a print 1.2 s after its pause (real board, 2026-11-22)."""
    told = refusal(line, PrinterSituation.of_job(printer), LineOrigin.JOB)
    assert "from 60 to 3600 s" in told
    assert "pause" in told
    assert "change of syringe" in told


@pytest.mark.parametrize("line", ["M84 S5", "M18 S5", "M84 S0", "M84 S600 X"])
@pytest.mark.parametrize("printer", [MARLIN, DUET], ids=["marlin", "duet"])
def test_a_time_of_the_motors_that_no_firmware_tells_is_set_by_no_job(printer, line):
    assert "take S out" in refusal(line, PrinterSituation.of_job(printer), LineOrigin.JOB)
    assert allowed(line[:3], PrinterSituation.of_job(printer), LineOrigin.JOB)


def test_a_switch_off_within_an_hour_passes_and_a_profile_s_longer_one():
    assert allowed("M85 S3600", PrinterSituation.of_job(MARLIN), LineOrigin.JOB)
    assert allowed("SET_IDLE_TIMEOUT", PrinterSituation.of_job(KLIPPER), LineOrigin.JOB)
    slow = MARLIN.model_copy(update={"idle_timeout_s": 7200})
    assert allowed("M85 S7200", PrinterSituation.of_job(slow), LineOrigin.JOB)


@pytest.mark.parametrize(
    "line",
    ["ACTIVATE_EXTRUDER", "ACTIVATE_EXTRUDER EXTRUDER=extruder9", "ACTIVATE_EXTRUDER EXTRUDER=a"]
    + ['ACTIVATE_EXTRUDER EXTRUDER="extruder1"', "SET_KINEMATIC_POSITION CLEAR=XYZ"]
    + ["SET_KINEMATIC_POSITION CLEAR_HOMED=XYZ", "SET_KINEMATIC_POSITION X=1 SET_HOMED=X"]
    + ["SET_KINEMATIC_POSITION", "SET_FAN_SPEED FAN=heater SPEED=99", "SET_FAN_SPEED FAN=fan"]
    + ["SET_FAN_SPEED SPEED=1", "SET_FAN_SPEED FAN=fan SPEED=-1", "SET_FAN_SPEED FAN=fan SPEED=a"],
)  # fmt: skip
def test_what_a_command_with_a_name_says_is_looked_at(line):
    assert refusal(line, PrinterSituation.of_job(KLIPPER), LineOrigin.JOB)


def test_quotes_round_a_plain_value_are_not_sent():
    known = PrinterSituation.of_job(KLIPPER)
    for line, sent in (
        ('ACTIVATE_EXTRUDER EXTRUDER="extruder"', "ACTIVATE_EXTRUDER EXTRUDER=extruder"),
        ('SET_FAN_SPEED FAN="fan" SPEED="0.5"', "SET_FAN_SPEED FAN=fan SPEED=0.5"),
        ("SET_KINEMATIC_POSITION X=1 Y=2 Z=3", "SET_KINEMATIC_POSITION X=1 Y=2 Z=3"),
    ):
        assert allowed(line, known, LineOrigin.JOB).text == sent


def test_a_macro_is_kept_with_moves_that_are_judged_later():
    assert isinstance(judge_stored_line("G1 X50", MARLIN), AllowedLine)
    assert isinstance(judge_stored_line("M104 S200", MARLIN), AllowedLine)
    assert isinstance(judge_stored_line("M500", MARLIN), Refusal)
    assert isinstance(judge_stored_line("G1 X50 X60", MARLIN), Refusal)


@given(st.text(max_size=40) | st.from_regex(r"[ GMTgmtN0-9.XYZEFSP*;()\"-]{0,30}", fullmatch=True))
def test_whatever_is_typed_is_answered_and_what_passes_is_read_the_same_again(typed):
    for known in MOMENTS:
        verdict = judge(typed, LineOrigin.CONSOLE, known)
        if isinstance(verdict, AllowedLine):
            again = judge(verdict.text, LineOrigin.CONSOLE, known)
            assert isinstance(again, AllowedLine)
            assert again.text == verdict.text
            assert verdict.text.isascii()
            assert verdict.text.isprintable()
            if verdict.target is not None:
                assert all(0 <= mm <= 200 for mm in verdict.target)
