"""G-code gate: allowed and refused codes, by origin and printer state."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from design.toolpath.gcode.table import dialect_of
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
from printctl.checks.gate.inputs import (
    IN_DISH_MM_S,
    RIM_MARGIN_MM,
    STEP_ASIDE_MM,
    STEP_DOWN_MM,
    NotAllowed,
    check_move,
    check_speed,
    reach,
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


ALL = (MARLIN, KLIPPER, DUET, PNEUMATIC)
AN_HOUR = "from 60 to 3600 s"
REFUSED = [
    # What changes the firmware.
    ((MARLIN,), "", ["M500", "M502", "M92 X1", "M206 X1", "M211 S0", "M220 S50", "M221 S95"]),
    ((MARLIN,), "", ["M301 P1", "M204 P99999", "M203 Z500", "M200 D1.75", "M900 K0.5", "G91"]),
    ((MARLIN,), "", ["M118 ok", "M113 S0", "M83", "M218 T1 X5", "M85 S600 X1", "M106 S300"]),
    ((MARLIN,), "", ["M155 S1", "SET_PIN PIN=a", "M17 S1e9"]),
    # A setting with which the dry run doesn't plan: M204 P60 T60 let a job pass as 4 s, not 11 s.
    (ALL, "", ["M204 P60 T60", "M204 S1", "M204 P0", "M204 T99999", "M201 X1", "M201 X0"]),
    (ALL, "", ["M203 X1", "M203 E0", "M205 J0.3", "M205 X5", "M205 S100", "M205 B0.5"]),
    (ALL, "", ["M566 X900", "SET_VELOCITY_LIMIT ACCEL=1", "SET_VELOCITY_LIMIT VELOCITY=50"]),
    (ALL, "", ["M205 T5"]),
    # M503 tells two decimals: 0.0149 became 0.01 at the job's end (real board, 2026-11-22).
    ((MARLIN,), "two decimals", [f"M205 J{MARLIN.junction_deviation_mm:g}"]),
    ((MARLIN,), "P60 isn't P1000 (acceleration_mm_s2 of Generic Marlin", ["M204 P60 T60"]),
    # A switch-off that never comes, or strikes in a pause: M85 S1 killed a print after 1.2 s.
    ((MARLIN,), AN_HOUR, ["M85 S3601", "M85 S999999", "M85 S-5", "M85 S0.5", "M85 S1", "M85 S59"]),
    ((KLIPPER,), AN_HOUR, [f"SET_IDLE_TIMEOUT TIMEOUT={seconds}" for seconds in
                           ("99999999", "-5", "abc", "nan", "inf", "0", "0.001", "59.9")]),
    ((KLIPPER,), AN_HOUR, ["SET_IDLE_TIMEOUT FOO=5", "SET_IDLE_TIMEOUT TIMEOUT=5 FOO=5"]),
    ((MARLIN,), "pause", ["M85 S0.5", "M85 S1", "M85 S59"]),
    ((MARLIN,), "change of syringe", ["M85 S0.5", "M85 S1", "M85 S59"]),
    # A time of the motors that no firmware tells.
    ((MARLIN, DUET), "take S out", ["M84 S5", "M18 S5", "M84 S0", "M84 S600 X"]),
    # Values that not each firmware reads alike.
    ((MARLIN, DUET), "", ["M302 P-1", "M302 P2", "M302 P0.5", "M302 S-1", "M302 S9999"]),
    # What a command with a name says.
    ((KLIPPER,), "", ["ACTIVATE_EXTRUDER", "ACTIVATE_EXTRUDER EXTRUDER=extruder9",
                      "ACTIVATE_EXTRUDER EXTRUDER=a", 'ACTIVATE_EXTRUDER EXTRUDER="extruder1"']),
    ((KLIPPER,), "", [f"SET_KINEMATIC_POSITION{words}" for words in
                      ("", " CLEAR=XYZ", " CLEAR_HOMED=XYZ", " X=1 SET_HOMED=X")]),
    ((KLIPPER,), "", [f"SET_FAN_SPEED {words}" for words in
                      ("FAN=heater SPEED=99", "FAN=fan", "SPEED=1", "FAN=fan SPEED=-1",
                       "FAN=fan SPEED=a")]),
]  # fmt: skip


@pytest.mark.parametrize(
    ("printer", "words", "line"),
    [
        (one, words, line)
        for printers, words, lines in REFUSED
        for line in lines
        for one in printers
    ],
)
def test_what_no_job_may_say_is_refused(printer, words, line):
    assert words in refusal(line, PrinterSituation.of_job(printer), LineOrigin.JOB)


@pytest.mark.parametrize(
    ("printers", "line"),
    [
        *(((MARLIN, DUET), line) for line in ("M302 P0", "M302 P1", "M302 S0", "M302 S170 P1")),
        *(((MARLIN, DUET), line) for line in ("M84", "M18")),
        ((MARLIN,), "M85 S3600"),
        ((KLIPPER,), "SET_IDLE_TIMEOUT"),
        ((MARLIN.model_copy(update={"idle_timeout_s": 7200}),), "M85 S7200"),  # the profile's own
    ],
)
def test_what_a_job_may_say_passes(printers, line):
    for printer in printers:
        assert allowed(line, PrinterSituation.of_job(printer), LineOrigin.JOB)


def test_a_job_may_set_what_is_undone_at_its_end():
    assert allowed("M204 P1000", PrinterSituation.of_job(MARLIN), LineOrigin.JOB).undo == ("M204",)
    assert allowed("M302 P1", PrinterSituation.of_job(MARLIN), LineOrigin.JOB).undo == ("M302",)


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


# --- soft limits of manual moves, against an oracle that samples the path
PRINTER = load(Printer, "generic_marlin")
NEEDLE = load(Needle, "25g")
DISHES = {name: load(Dish, name) for name in ("petri_60mm", "petri_35mm", "chamber_slide")}
FLOOR = 3.0
NM = 1e-6


def bounds(dish: str = "petri_60mm", **changed: object) -> Bounds:
    told = {
        "trusted": True,
        "needle": NEEDLE,
        "dish": DISHES[dish],
        "centre_mm": (100.0, 100.0),
        "floor_mm": FLOOR,
    }
    return Bounds(PRINTER, **{**told, **changed})  # type: ignore[arg-type]


def refused(why: str, known: Bounds, start: tuple, target: tuple) -> None:
    with pytest.raises(NotAllowed, match=why):
        check_move(known, start, target)


coordinate = st.floats(-10, 210)
place = st.tuples(coordinate, coordinate, st.floats(-5, 60))
near = st.tuples(st.floats(60, 140), st.floats(60, 140), st.floats(0, 30))


@given(st.sampled_from(sorted(DISHES)), place | near, near | place)
def test_no_accepted_move_touches_dish_or_leaves_the_machine(name, start, target):
    known = bounds(name)
    try:
        check_move(known, start, target)
    except NotAllowed:
        return
    moved = [mm for mm, was in zip(target, start, strict=True) if mm != was]
    assert all(-NM <= mm <= 200 + NM for mm in moved)
    if math.dist(start[:2], target[:2]) <= NM and target[2] >= start[2]:
        return  # straight up
    assert target[2] >= FLOOR - NM
    dish = DISHES[name]
    way = np.linspace(start, target, 60)
    low = way[way[:, 2] < FLOOR + dish.wall_mm]
    off = np.abs(low[:, :2] - 100)
    half = np.array([dish.inner_x_mm, dish.inner_y_mm]) / 2
    room = half[0] - np.hypot(*off.T) if dish.shape == "round" else (half - off).min(axis=1)
    assert (room >= NEEDLE.outer_mm / 2 - 1e-6).all(), "the shaft would be in the wall"


@given(near, st.floats(0, 100))
def test_straight_up_is_free_from_wherever_the_tip_is(start, by):
    known = bounds(part_in_dish=True)
    assume(start[2] + by <= 200)
    check_move(known, start, (start[0], start[1], start[2] + by))


@given(near, st.sampled_from(sorted(DISHES)))
def test_reach_is_what_may_be_reached(at, name):
    known = bounds(name)
    low, high = reach(known, at)
    for axis in range(3):
        for end in (low[axis], high[axis]):
            target = (*at[:axis], end, *at[axis + 1 :])
            check_move(known, at, target)
        assert low[axis] <= at[axis] <= high[axis]


def test_floor_is_where_it_was_touched():
    refused(r"Z 2.90 mm is below the dish's floor.*3.00", bounds(), (100, 100, 4), (100, 100, 2.9))
    check_move(bounds(), (100, 100, 4), (100, 100, 3.0))


def test_wall_is_crossed_above_the_rim_only():
    over = FLOOR + DISHES["petri_60mm"].wall_mm + RIM_MARGIN_MM + 0.01
    check_move(bounds(), (100, 100, over), (150, 100, over))
    refused("of the wall of", bounds(), (100, 100, over - 0.1), (150, 100, over - 0.1))
    refused("of the wall of", bounds(), (150, 100, over), (150, 100, over - 5))


def test_hub_stays_clear_of_the_wall_too():
    tip = FLOOR + 0.5
    short = NEEDLE.model_copy(update={"length_mm": 8.0, "hub_outer_mm": 12.0})
    edge = 100 + DISHES["petri_60mm"].inner_x_mm / 2 - 4
    check_move(bounds(), (100, 100, tip), (edge, 100, tip))
    refused("needle's hub", bounds(needle=short), (100, 100, tip), (edge, 100, tip))


def test_untrusted_position_allows_small_steps_and_up():
    known = Bounds(PRINTER)
    check_move(known, (0, 0, 0), (0, 0, 150))
    check_move(known, (0, 0, 0), (STEP_ASIDE_MM, 0, 0))
    check_move(known, (0, 0, 0), (0, 0, -STEP_DOWN_MM))
    refused("aside in one step, at most 10", known, (0, 0, 0), (11, 0, 0))
    refused("down in one step, at most 1 mm.*isn't trusted", known, (0, 0, 0), (0, 0, -1.1))
    refused("longer than the axis", known, (0, 0, 0), (0, 0, 201))


@pytest.mark.parametrize(
    ("missing", "why"), [("floor_mm", "isn't touched off"), ("centre_mm", "where the dish stands")]
)
def test_unknown_dish_allows_small_steps(missing, why):
    known = bounds(**{missing: None})
    check_move(known, (100, 100, 6), (101, 100, 6))
    refused(why, known, (100, 100, 6), (102, 100, 6))
    refused(why, known, (100, 100, 6), (100, 100, 4.5))


def test_bath_that_holds_a_print_is_left_straight_up():
    known = bounds(part_in_dish=True, bath_level_mm=9.0)
    refused("holds a print", known, (100, 100, 8), (101, 100, 8))
    refused("holds a print", known, (100, 100, 10), (100, 100, 8.9))
    check_move(known, (100, 100, 9.5), (101, 100, 9.5))


def test_without_needle_nothing_but_the_machine_limits():
    check_move(bounds(needle=None), (100, 100, 50), (0, 0, 0))
    refused("outside 0 to 200", bounds(needle=None), (100, 100, 50), (0, 0, -0.1))


@given(near, near, st.floats(0.1, 400))
def test_accepted_speeds_are_within_each_axis(start, target, speed):
    assume(math.dist(start, target) > 0.01)
    known = bounds()
    try:
        check_speed(known, start, target, speed)
    except NotAllowed:
        return
    part = np.abs(np.subtract(target, start)) / math.dist(start, target) * speed
    limits = [getattr(PRINTER.max_speed_mm_s, axis) for axis in "xyz"]
    assert (part <= np.array(limits) * (1 + 1e-6)).all()
    if min(start[2], target[2]) < FLOOR + DISHES["petri_60mm"].wall_mm:
        assert speed <= IN_DISH_MM_S * (1 + 1e-6)


@pytest.mark.parametrize("speed", [0.0, -1.0, math.nan, math.inf])
def test_speed_that_is_none_is_refused(speed):
    with pytest.raises(NotAllowed, match=r"above 0|exceeds"):
        check_speed(bounds(), (100, 100, 50), (110, 100, 50), speed)
