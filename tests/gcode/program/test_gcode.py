"""G-code reader, against slow oracles."""

import math
import re
from functools import reduce
from operator import xor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcode.errors import GcodeError
from gcode.program.gcode import checksum, parse_line, read_gcode
from gcode.program.modal import DWELL, OTHER, SYNC
from tests.sim.transcripts import DATA
from tests.slower import examples

MARKS = (b"\xff\xfe", b"\xfe\xff")  # of UTF-16: refused


def naive_program(text):
    """End of each move, line by line, for G0 G1 G20 G21 G90 G91 G92 M82 M83."""
    position, shift, feed, unit = [0.0] * 4, [0.0] * 4, 25.0, 1.0
    relative = [False] * 4
    rows = []
    for number, raw in enumerate(text.split("\n"), start=1):
        line = raw.partition(";")[0].strip()
        if not line:
            continue
        command, *_ = line.split()
        words = {a: float(b) for a, b in re.findall(r"([XYZEF])([-+]?\d*\.?\d+)", line)}
        if command in ("G0", "G1"):
            for axis, letter in enumerate("XYZE"):
                if letter in words:
                    value = words[letter] * unit
                    if relative[axis]:
                        position[axis] += value
                    else:
                        position[axis] = value - shift[axis]
            feed = words["F"] * unit / 60 if words.get("F", 0) > 0 else feed
        elif command in ("G20", "G21"):
            unit = 25.4 if command == "G20" else 1.0
        elif command in ("G90", "G91"):
            relative = [command == "G91"] * 4
        elif command in ("M82", "M83"):
            relative[3] = command == "M83"
        elif command == "G92":
            for axis, letter in enumerate("XYZE"):
                if letter in words:
                    if letter == "E":
                        position[3] = words["E"] * unit
                    else:
                        shift[axis] = words[letter] * unit - position[axis]
        rows.append((number, list(position), feed))
    return rows


numbers = st.integers(-200_000, 200_000).map(lambda n: f"{n / 1000:.3f}")
words = st.lists(st.tuples(st.sampled_from("XYZE"), numbers), max_size=4)
moves = st.tuples(st.sampled_from(["G0", "G1"]), words, st.integers(1, 9000)).map(
    lambda t: f"{t[0]} {' '.join(a + b for a, b in t[1])} F{t[2]}"
)
positions = words.filter(bool).map(lambda w: "G92 " + " ".join(a + b for a, b in w))
modes = st.sampled_from(["G90", "G91", "M82", "M83", "G20", "G21", "; a remark", "", "  "])
programs = st.lists(st.one_of(moves, moves, positions, modes), max_size=30).map("\n".join)


@given(programs)
@settings(max_examples=examples(60), deadline=None)
def test_modal_state_agrees_with_a_line_by_line_oracle(text):
    program = read_gcode(text.encode())
    expected = naive_program(text)
    assert program.line.tolist() == [row[0] for row in expected]
    assert program.command.tolist() == list(range(len(expected)))
    for got, feed, row in zip(program.target, program.feed, expected, strict=True):
        np.testing.assert_allclose(got, row[1], atol=1e-9)
        assert math.isclose(feed, row[2], rel_tol=1e-12)


@given(st.binary(max_size=120))
@settings(max_examples=examples(100), deadline=None)
def test_checksum_is_the_xor_of_all_bytes(line):
    assert checksum(line) == reduce(xor, line, 0)


@given(st.binary(max_size=60).filter(lambda b: b"\0" not in b and not b.startswith(MARKS)))
@settings(max_examples=examples(100), deadline=None)
def test_no_line_of_rubbish_breaks_the_reader(line):
    parse_line(line)
    read_gcode(line)


def test_a_line_is_taken_apart_as_the_firmware_does():
    command = parse_line(b"N12 G92 X1 E X-2.50 Y.5 Q*77 ; remark\r\n")
    assert (command.letter, command.number) == ("G", 92)
    assert command.name == "G92"
    assert command.line_number == 12
    assert command.values == {"X": -2.5, "Y": 0.5}
    assert command.flags == {"E", "Q"}
    assert command.text == b"G92 X1 E X-2.50 Y.5 Q"


@pytest.mark.parametrize(
    ("line", "values"),
    [
        (b"G 1 X 5\x20 Y6", {"X": 5, "Y": 6}),
        (b"G1 X1.2.3 Y2", {"X": 1.2, "Y": 2}),
        (b"G1 X--5 Y2", {"Y": 2}),
        (b"G1 X5mm Y2", {"X": 5, "Y": 2}),
        (b"G1 X1e3", {"X": 1}),
        (b"G65537 X5", {"X": 5}),
        (b"G1.5 X5", {"X": 5}),
        (b"G01 x5 Y1", {"Y": 1}),
    ],
)
def test_a_firmware_reads_malformed_lines_too(line, values):
    """Read back from a real Marlin by `benchmarks/firmware_lines.py`; no job has such lines."""
    command = parse_line(line)
    assert command.name == "G1"
    assert command.values == values


def test_dwell_and_temperature_carry_their_value():
    program = read_gcode(b"G4 P250\nG4 S2 P9\nM109 R37\nM302 P1\nM105\n")
    np.testing.assert_array_equal(program.value, [0.25, 2.0, 37.0, 1.0, np.nan])
    assert program.kind.tolist() == [DWELL, DWELL, SYNC, OTHER, OTHER]


@pytest.mark.parametrize(
    ("line", "turn"),
    [("G3 X0 Y10 I-10 J0", 0.5), ("G2 X0 Y10 I-10 J0", 1.5), ("G3 X0 Y10 R10", 0.5)],
)
def test_an_arc_keeps_its_radius_and_length(line, turn):
    program = read_gcode(f"G1 X10 Y0\n{line} Z3 E4\n".encode())
    points = program.target
    np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 1]), 10, atol=1e-9)
    np.testing.assert_allclose(points[-1], [0, 10, 3, 4], atol=1e-12)
    chords = np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1)
    assert chords.max() <= 1.0
    assert math.isclose(chords.sum(), turn * math.pi * 10, rel_tol=1e-3)
    assert set(program.line[1:].tolist()) == {2}
    assert program.length[1:].tolist() == [len(line) + 6] + [0] * (len(points) - 2)


def test_a_binary_file_is_refused():
    with pytest.raises(GcodeError, match=r"line 1 of the G-code has a NUL \(byte 2\)"):
        read_gcode(b"G1\0")


def test_the_recorded_file_ends_where_it_was_recorded():
    program = read_gcode((DATA / "fresh.gcode").read_bytes(), (50, 50, 0))
    assert len(program) == 490
    np.testing.assert_allclose(program.target[-1], [50, 50, 0.18, 7.08452], atol=1e-9)
