"""G-code writer, checked by an independent reader; marks; jobs written part by part."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from functools import cache, partial
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.errors import ToolpathError
from design.toolpath import MoveBuilder, MoveKind, Toolpath, join_toolpaths
from design.toolpath.embedded import EmbeddedOptions, plan_embedded
from design.toolpath.fresh import FreshLayers, FreshOptions, plan_fresh
from design.toolpath.gcode import Gcode, GcodeOptions, save_gcode, stream_gcode, write_gcode
from design.toolpath.gcode.commands import long_enough
from design.toolpath.gcode.table import Table, render
from firmware_profiles import Printer, load
from tests.design.toolpath.gcode_reader import Machine
from tests.design.toolpath.plans import PLACE, SYRINGE, embedded, fresh, fresh_toolpath
from tests.design.toolpath.shapes import as_solid, block, random_tree, upright
from tests.slower import examples, first_of

PRINTER = load(Printer, "generic_marlin")
dwelling = partial(embedded, dwell_s=0.15)
PER_UL = 4 / (np.pi * SYRINGE.inner_mm**2)


def line(count, step_mm, volume_ul, speed=20.0):
    """A straight path along x."""
    builder = MoveBuilder((0, 0, 0.06), "layer", 0.06)
    x = np.arange(1, count + 1) * step_mm
    points = np.column_stack([x, 0 * x, 0 * x + 0.06])
    builder.write(points, np.full(count, volume_ul), speed, 0)
    return builder.build()


@pytest.mark.parametrize("make", [fresh, dwelling])
@pytest.mark.parametrize("name", ["generic_marlin", "marlin_avr"])
def test_every_line_ends_where_its_move_ends(make, name):
    printer, toolpath = load(Printer, name), make()
    gcode = write_gcode(toolpath, printer, SYRINGE, PLACE)
    machine = Machine().read(gcode.data)
    plunger = np.cumsum(toolpath.volume_ul) * PER_UL
    steps = printer.steps_per_mm
    for number, move in enumerate(gcode.line_move):
        if move < 0:
            continue
        position, travelled, _ = machine.states[number]
        end = toolpath.end[move] + PLACE
        for value, axis, per_mm in zip(end, "XYZ", (steps.x, steps.y, steps.z), strict=True):
            assert float(position[axis]) == pytest.approx(value, abs=min(5.1e-4, 0.125 / per_mm))
        assert float(travelled) == pytest.approx(plunger[move], abs=0.125 / steps.e)


@pytest.mark.parametrize("make", [fresh, dwelling])
def test_no_ink_is_lost(make):
    toolpath = make()
    gcode = write_gcode(toolpath, PRINTER, SYRINGE, PLACE, GcodeOptions(relieve_ul=0))
    pushed = float(Machine().read(gcode.data).plunger) / PER_UL
    assert pushed == pytest.approx(toolpath.written_ul, abs=0.5e-5 / PER_UL)


def test_maps_name_source_and_last_move_of_each_line():
    toolpath = embedded()
    gcode = write_gcode(toolpath, PRINTER, SYRINGE, PLACE)
    known = gcode.line_move >= 0
    assert len(gcode.line_move) == gcode.data.count(b"\n") == len(gcode.line_source)
    assert (np.diff(gcode.line_move[known]) > 0).all()
    assert np.array_equal(gcode.line_source[known], toolpath.source[gcode.line_move[known]])
    assert (gcode.line_source[~known] == -1).all()
    assert gcode.source_kind == "vessel"


def test_header_sets_modes_the_job_never_homes_and_goes_in_from_above():
    machine = Machine().read(write_gcode(fresh(), PRINTER, SYRINGE, PLACE).data)
    modes = ["G21", "G90", "M82", "M220 S100", "M221 S100", "M200 D0"]
    assert machine.lines[:9] == ["M85 S600", *modes, "M302 P1", "G92 E0"]
    assert not any(text.startswith("G28") for text in machine.lines)
    assert not any(mark in text for text in machine.commands for mark in ";()")
    assert machine.lines[9:12] == ["G0 Z25.8 F300", "G0 X60.075 Y70.075 F1200", "G0 Z20.06 F300"]


def test_feeds_respect_every_axis_and_are_given_only_when_changed():
    machine = Machine().read(write_gcode(embedded(), PRINTER, SYRINGE, PLACE).data)
    limits = PRINTER.max_speed_mm_s
    given = [text.split("F")[1] for text in machine.lines if "F" in text]
    assert all(one != other for one, other in pairwise(given))
    for before, after in pairwise(machine.states[11:]):
        change = [float(after[0][axis] - before[0][axis]) for axis in "XYZ"]
        length, pushed = np.linalg.norm(change), abs(float(after[1] - before[1]))
        if length == 0 and pushed == 0:
            continue
        seconds = (length or pushed) / (float(after[2]) / 60)
        limit = np.array([limits.x, limits.y, limits.z])
        assert (np.abs(change) / seconds <= limit * 1.01).all()  # text is rounded
        assert pushed / seconds <= limits.e * 1.01


def test_primes_and_retractions_take_their_time():
    toolpath = fresh()
    gcode = write_gcode(toolpath, PRINTER, SYRINGE, PLACE)
    machine = Machine().read(gcode.data)
    retract = np.flatnonzero(toolpath.kind == MoveKind.RETRACT)
    number = int(np.flatnonzero(gcode.line_move == retract[0])[0])
    before, after = machine.states[number - 1], machine.states[number]
    assert float(before[1] - after[1]) == pytest.approx(0.02 * PER_UL, abs=1e-5)
    assert float(after[2]) / 60 == pytest.approx(0.4 * PER_UL, rel=1e-3)


def test_dwells_are_written_in_milliseconds():
    toolpath = dwelling()
    count = np.count_nonzero(toolpath.kind == MoveKind.DWELL)
    machine = Machine().read(write_gcode(toolpath, PRINTER, SYRINGE, PLACE).data)
    assert machine.pause_ms == 150 * count


def test_e_is_counted_anew_before_float32_loses_it():
    toolpath = line(400, 0.5, 3.0)  # 72 mm of plunger
    gcode = write_gcode(toolpath, PRINTER, SYRINGE, PLACE, GcodeOptions(relieve_ul=0))
    machine = Machine().read(gcode.data)
    assert sum(text.startswith("G92") for text in machine.lines) > 3
    assert float(machine.plunger) == pytest.approx(1200 * PER_UL, abs=0.5e-5)
    steps, last = 0.0, np.float32(0)
    for text in machine.lines:  # as the firmware counts: float32 in, whole steps out
        for word in text.split(" ")[1:]:
            if word[0] == "E":
                value = np.float32(word[1:])
                target = np.rint(value * np.float32(PRINTER.steps_per_mm.e))
                steps += 0 if text.startswith("G92") else target - last
                last = target
    assert steps == pytest.approx(1200 * PER_UL * PRINTER.steps_per_mm.e, abs=1.0)


def test_each_short_segment_has_its_own_dose_to_a_percent_in_float32_too():
    """0.13 mm of a line 0.15 x 0.06 mm, in a bore of 4.61 mm: 7e-5 mm of plunger."""
    dose, count = 0.13 * 0.137 * 0.06, 20_000
    builder = MoveBuilder((0, 0, 0.06), "layer", 0.06)
    x = 0.13 * (np.arange(1, count + 1) % 2)
    points = np.column_stack([x, 0 * x, 0 * x + 0.06])
    builder.write(points, np.full(count, dose), 20.0, 0)
    gcode = write_gcode(builder.build(), PRINTER, SYRINGE, PLACE, GcodeOptions(relieve_ul=0))
    doses, at = [], 0.0
    for text in Machine().read(gcode.data).lines:
        for word in text.split(" ")[1:]:
            if word[0] == "E":
                value = float(np.float32(word[1:]))
                if text.startswith("G1 X"):
                    doses.append(value - at)
                at = value
    assert len(doses) == count
    assert np.array(doses) == pytest.approx(dose * PER_UL, rel=0.01)
    assert sum(doses) == pytest.approx(count * dose * PER_UL, rel=1e-6)


def test_a_move_that_e_cannot_hold_is_refused():
    with pytest.raises(ToolpathError, match="one move pushes the plunger"):
        write_gcode(line(2, 0.5, 1000.0), PRINTER, SYRINGE, PLACE)


@pytest.mark.parametrize("place", [(0, 0), (0, 0, np.nan)])
def test_impossible_places_are_refused(place):
    with pytest.raises(ToolpathError, match="place_mm"):
        write_gcode(fresh(), PRINTER, SYRINGE, place)


@pytest.mark.parametrize("name", ["travel_speed_mm_s", "flow_factor"])
def test_impossible_options_are_refused(name):
    with pytest.raises(ToolpathError, match=f"{name} is 0"):
        GcodeOptions(**{name: 0})


def test_flow_factor_drives_the_plunger_farther_and_changes_no_path():
    plain = Machine().read(
        write_gcode(fresh(), PRINTER, SYRINGE, PLACE, GcodeOptions(relieve_ul=0)).data
    )
    options = GcodeOptions(relieve_ul=0, flow_factor=0.8)
    driven = Machine().read(write_gcode(fresh(), PRINTER, SYRINGE, PLACE, options).data)
    assert float(driven.plunger) == pytest.approx(float(plain.plunger) / 0.8, abs=1e-4)
    assert driven.position == plain.position


# G-code text, digits and merging of moves, against slow oracles.

DECIMALS = (3, 3, 4, 5, 3, 0)


@settings(max_examples=examples(200))
@given(st.lists(st.integers(-(10**12), 10**12), min_size=6, max_size=6), st.integers(0, 63))
def test_text_is_the_exact_value_without_idle_digits(values, mask):
    given_words = np.array([[bool(mask >> k & 1) for k in range(6)]])
    none = np.array([-1])
    head = np.zeros(1, dtype=np.int8)
    table = Table(np.array([1]), np.array([values]), given_words, none, none, head)
    text, longest = render(table, DECIMALS)
    assert longest == len(text) - 1
    words = text.decode().rstrip("\n").split(" ")
    assert words[0] == "G1"
    expected = {
        letter: Fraction(value, 10**digits)
        for letter, value, digits, there in zip(
            "XYZEFP", values, DECIMALS, given_words[0], strict=True
        )
        if there
    }
    assert {word[0]: Fraction(word[1:]) for word in words[1:]} == expected
    for word in words[1:]:
        assert not ("." in word and word[-1] in "0.")
        assert not word[1:].startswith(("00", "-00", ".", "-."))


# Start and end G-code of a job, for each firmware family.

MARLIN = load(Printer, "generic_marlin")
MODES = ["G21", "G90", "M82", "M220 S100", "M221 S100"]
LINEAR = [*MODES, "M200 D0"]
HEADERS = {
    "marlin": ["M85 S600", *LINEAR, "M302 P1", "G92 X50 Y60 Z30 E0"],
    "prusa": ["M85 S600", *LINEAR, "M302 S0", "G92 X50 Y60 Z30 E0"],
    "reprapfirmware": [*LINEAR, "M302 P1", "G92 X50 Y60 Z30 E0"],
    "klipper": [
        "SET_IDLE_TIMEOUT TIMEOUT=600",
        *MODES,
        "SET_GCODE_OFFSET X=0 Y=0 Z=0",
        "SET_KINEMATIC_POSITION X=50.000 Y=60.000 Z=30.0000",
        "G92 E0",
    ],
}


def of(firmware: str, **more: object) -> Printer:
    return MARLIN.model_copy(update={"firmware": firmware, **more})


def lines_of(printer: Printer, options: GcodeOptions) -> list[str]:
    toolpath = fresh_toolpath(as_solid(block(2, 2, 0.12)), FreshOptions())
    gcode = write_gcode(toolpath, printer, SYRINGE, PLACE, options)
    lines = gcode.data.decode().split("\n")[:-1]
    assert len(lines) == len(gcode.line_source) == len(gcode.line_move)
    return lines


@pytest.mark.parametrize("firmware", sorted(HEADERS))
def test_header_and_footer_are_the_family_s_own(firmware: str) -> None:
    lines = lines_of(of(firmware), GcodeOptions(start_mm=(50.0, 60.0, 30.0)))
    header = HEADERS[firmware]
    assert lines[: len(header)] == header
    assert lines[len(header)].startswith("G0")
    assert lines[-1] == "M400"


@pytest.mark.parametrize("firmware", sorted(HEADERS))
def test_between_header_and_footer_all_families_read_the_same(firmware: str) -> None:
    options = GcodeOptions(start_mm=(50.0, 60.0, 30.0))
    body = lines_of(of(firmware), options)[len(HEADERS[firmware]) : -1]
    assert body == lines_of(MARLIN, options)[len(HEADERS["marlin"]) : -1]


def test_an_unknown_start_isn_t_declared_to_klipper() -> None:
    lines = lines_of(of("klipper"), GcodeOptions())
    assert not any(line.startswith("SET_KINEMATIC") for line in lines)
    assert lines[7] == "G92 E0"


def test_end_relieves_lifts_straight_up_and_waits():
    options = GcodeOptions(relieve_ul=0.5, plunger_ul_s=2.0)
    machine = Machine().read(write_gcode(fresh(), PRINTER, SYRINGE, PLACE, options).data)
    before, relieved, lifted = machine.states[-4], machine.states[-3], machine.states[-2]
    assert float(before[1] - relieved[1]) == pytest.approx(0.5 * PER_UL, abs=1e-5)
    assert float(relieved[2]) == pytest.approx(2.0 * PER_UL * 60, abs=1e-3)
    assert lifted[0]["X"] == before[0]["X"]
    assert lifted[0]["Z"] > before[0]["Z"]
    assert machine.lines[-1] == "M400"


def test_lift_stays_below_the_top_of_the_printer():
    gcode = write_gcode(fresh(), PRINTER, SYRINGE, (60, 70, 198))
    heights = [state[0]["Z"] for state in Machine().read(gcode.data).states if state[0]["Z"]]
    assert max(heights) == PRINTER.z_mm.high


def test_writing_speed_is_the_asked_one_where_no_limit_stands():
    machine = Machine().read(write_gcode(line(20, 0.5, 0.0045), PRINTER, SYRINGE, PLACE).data)
    assert machine.lines[12].endswith("F1200")


def test_moves_too_short_for_the_planner_are_merged():
    turn = np.linspace(0, 2 * np.pi, 400)[1:]
    builder = MoveBuilder((2, 0, 0.06), "layer", 0.06)
    points = np.column_stack([2 * np.cos(turn), 2 * np.sin(turn), 0 * turn + 0.06])
    builder.write(points, np.full(len(turn), 3e-4), 20, 0)
    gcode = write_gcode(builder.build(), PRINTER, SYRINGE, PLACE)
    # From the path's first point to its last; then come the mark, relief, lift and M400.
    writing = [state[0] for state in Machine().read(gcode.data).states[11:-4]]
    place = np.array([[float(p["X"]), float(p["Y"])] for p in writing]) - PLACE[:2]
    steps = np.abs(np.diff(place, axis=0)).max(axis=1) * 80
    assert steps.min() >= PRINTER.min_steps_per_segment
    assert len(place) > 100
    middle = (place[1:] + place[:-1]) / 2
    assert np.linalg.norm(middle, axis=1).min() > 2 - 0.002
    assert place[-1] == pytest.approx([2, 0], abs=1e-3)


def _cut(way, chosen):
    """Squared distances of the left out vertices from the chosen way, by half the way beside."""
    total = 0.0
    for begin, end in pairwise(chosen):
        a, c = way[begin, :3], way[end, :3]
        for v in range(begin + 1, end):
            share = np.clip((way[v, :3] - a) @ (c - a) / ((c - a) @ (c - a)), 0.0, 1.0)
            away = way[v, :3] - a - share * (c - a)
            beside = np.abs(np.diff(way[v - 1 : v + 2, :3], axis=0)).sum()
            total += 0.5 * beside * float(away @ away)
    return total


@pytest.mark.parametrize("seed", first_of(range(40), 10))
def test_no_other_choice_of_vertices_cuts_off_less(seed):
    rng = np.random.default_rng(seed)
    turn = np.cumsum(rng.normal(0.0, 0.6, 9))
    step = rng.uniform(1.0, 9.0, 9)[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    way = np.zeros((10, 4))
    way[1:, :2] = np.cumsum(step, axis=0)
    choices = [(0, *inner, 9) for count in range(9) for inner in combinations(range(1, 9), count)]
    fit = [c for c in choices if (np.abs(np.diff(way[list(c)], axis=0)).max(axis=1) >= 7).all()]
    chosen = (0, *(np.flatnonzero(long_enough(way, np.zeros(9, dtype=np.int64), 7.0)) + 1).tolist())
    assert chosen in (fit or [(0, 9)])  # a run ends where it ended
    if fit:
        assert _cut(way, chosen) == pytest.approx(min(_cut(way, c) for c in fit))


# Marks where a job may be interrupted: comments that change no command.


def machine_of(toolpath: Toolpath) -> Machine:
    return Machine().read(write_gcode(toolpath, PRINTER, SYRINGE, PLACE).data)


def test_each_layer_ends_once_relieved_and_at_the_next_ones_height():
    machine = machine_of(fresh())
    ends = [k for k, text in enumerate(machine.lines) if text.startswith(";LAYER_END")]
    assert [machine.lines[k] for k in ends] == [f";LAYER_END:{k}" for k in range(len(ends))]
    assert len(ends) == 5
    for k in ends[:-1]:
        assert machine.lines[k + 1] == ";RELOAD"
        # One layer, and what keeps the needle off the fresh ink or above the open lumen.
        rise = float(machine.states[k][0]["Z"] - machine.states[k - 3][0]["Z"])
        above = min((FreshOptions.hop_mm, FreshOptions.lift_mm), key=lambda mm: abs(rise - mm))
        assert rise == pytest.approx(0.06 + above)
        plunger = [float(state[1]) for state in machine.states[: k + 1]]
        assert plunger[-1] < max(plunger)
    assert machine.lines[ends[-1] + 1] != ";RELOAD"


def test_each_pass_ends_with_a_free_way_straight_up():
    options = EmbeddedOptions()
    plan = plan_embedded(random_tree(20, 10, 3, 0.1), options)
    machine = machine_of(plan.toolpath)
    ends = [k for k, text in enumerate(machine.lines) if text.startswith(";PASS_END")]
    assert len(ends) == plan.report.passes > 3
    assert [text for text in machine.lines if text == ";RELOAD"] == [";RELOAD"] * (len(ends) - 1)
    written = []
    for before, after in zip([9, *ends], ends[:-1], strict=False):
        for last, here in pairwise(machine.states[before:after]):
            if here[1] > last[1]:
                way = [[float(state[0][axis]) for axis in "XYZ"] for state in (last, here)]
                written.append(np.linspace(*way, 50))
        tip = np.array([float(machine.states[after][0][axis]) for axis in "XYZ"])
        ink = np.concatenate(written)
        near = np.linalg.norm((ink - tip)[:, :2], axis=1) < options.needle_outer_mm / 2 + 0.1
        assert (ink[near, 2] < tip[2]).all()


def test_marks_change_no_command():
    toolpath = fresh()
    one_layer = replace(toolpath, source=np.zeros_like(toolpath.source))
    assert machine_of(toolpath).commands == machine_of(one_layer).commands
    assert machine_of(one_layer).lines[-4:-3] == [";LAYER_END:0"]


def test_e_counted_anew_comes_after_the_mark():
    builder = MoveBuilder((0, 0, 0.06), "layer", 0.06)
    for layer in range(6):
        z = 0.06 * (layer + 1)
        if layer:
            builder.plunge(-0.02, 0.4, layer)
            builder.travel(np.array([[*builder.tip[:2], z]]), 5, layer)
            builder.plunge(0.02, 0.4, layer)
        points = np.array([[60.0 * (layer % 2 == 0), 0, z]])
        builder.write(points, np.array([250.0]), 20, layer)
    gcode = write_gcode(builder.build(), PRINTER, SYRINGE, PLACE, GcodeOptions(relieve_ul=0))
    machine = Machine().read(gcode.data)
    assert sum(text.startswith("G92") for text in machine.lines) > 1
    assert machine.lines.count(";RELOAD") == 5


# Streamed jobs: byte for byte those written as a whole.


KNOWN = (60.0, 70.0, 45.0)


@cache
def taller():
    return as_solid(block(6, 5, 0.6) - upright(2, 1.5, 1))


def streamed(parts, top, printer, options):
    return list(stream_gcode(parts, printer, SYRINGE, PLACE, options, top))


@pytest.mark.parametrize("start", [None, KNOWN])
@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("generic_marlin", {}),
        ("marlin_avr", {}),
        ("klipper_bioprinter", {}),
        ("pneumatic_marlin", {"flow_ul_s": 0.12}),
    ],
)
def test_layers_written_one_by_one_are_the_job_of_their_whole(name, more, start):
    printer, options = load(Printer, name), GcodeOptions(start_mm=start, **more)
    layers = FreshLayers(taller(), FreshOptions())
    parts = list(layers)
    assert len(parts) == 10
    whole = join_toolpaths(parts)
    top = float(whole.end[:, 2].max())
    got = Gcode.joined(streamed(parts, top, printer, options))
    expected = write_gcode(whole, printer, SYRINGE, PLACE, options)
    assert got.data == expected.data
    for name in ("line_source", "line_move", "line_kind"):
        np.testing.assert_array_equal(getattr(got, name), getattr(expected, name))


def test_the_plunger_s_count_goes_on_over_the_parts():
    printer = load(Printer, "generic_marlin")
    parts = [
        replace(part, volume_ul=400 * part.volume_ul)
        for part in FreshLayers(taller(), FreshOptions())
    ]
    whole = join_toolpaths(parts)
    top = float(whole.end[:, 2].max())
    got = Gcode.joined(streamed(parts, top, printer, None))
    assert got.data.count(b"G92") > 5
    assert got.data == write_gcode(whole, printer, SYRINGE, PLACE).data


def test_a_part_is_given_back_before_the_next_but_one_is_asked_for():
    asked = []

    def parts():
        for part in FreshLayers(taller(), FreshOptions()):
            asked.append(len(asked))
            yield part

    printer, layers = load(Printer, "generic_marlin"), FreshLayers(taller(), FreshOptions())
    job = stream_gcode(parts(), printer, SYRINGE, PLACE, None, layers.top_mm)
    for number in range(4):
        next(job)
        assert len(asked) == number + 2


def test_layers_say_their_top_before_they_are_made_and_their_numbers_after():
    layers = FreshLayers(taller(), FreshOptions())
    top = layers.top_mm
    highest = max(float(part.end[:, 2].max()) for part in layers)
    assert highest <= top <= highest + FreshOptions.lift_mm
    assert layers.report().written_ul == pytest.approx(
        plan_fresh(taller(), FreshOptions()).report.written_ul
    )
    assert len(list(layers)) == len(list(layers))


def test_a_job_that_fails_on_the_way_leaves_no_file(tmp_path):
    out, lines = tmp_path / "job.gcode", tmp_path / "job.map.npz"
    parts = list(FreshLayers(taller(), FreshOptions()))
    job = stream_gcode(parts, load(Printer, "generic_marlin"), SYRINGE, PLACE, None, 0.4)
    with pytest.raises(ToolpathError):
        save_gcode(out, lines, job)
    assert list(tmp_path.iterdir()) == []
