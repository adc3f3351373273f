"""Job files: accepted commands, needle position, path out of the bath."""

from __future__ import annotations

import hashlib
import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_profiles import Printer, load
from firmware_profiles.families.position_reply import parse_position
from printctl.machine.link.errors import JobError
from printctl.machine.link.modal import (
    Modal,
    disagreement,
    modal_state,
)
from printctl.machine.link.retreat import Retreat, heaters_off
from tests.printctl.machine.link.jobs import load_job, parse_job

PRINTER = load(Printer, "generic_marlin")


def test_comments_and_blanks_are_left_out_and_lines_keep_their_place():
    job = parse_job(b"; head\r\n\r\nG90 (absolute)\nM82\n\n  G1 X1 ; there\n", "a")
    assert job.lines == [b"G90", b"M82", b"G1 X1"]
    assert [job.file_line(done) for done in range(5)] == [0, 3, 4, 6, 6]


def test_a_byte_order_mark_is_not_sent():
    text = b"M302 P1\nG90\nG1 X1\n"
    marked = parse_job(b"\xef\xbb\xbf" + text, "a")
    assert (marked.lines, marked.file_lines) == ([b"M302 P1", b"G90", b"G1 X1"], [1, 2, 3])
    assert marked.sha256 == hashlib.sha256(b"\xef\xbb\xbf" + text).hexdigest()


@pytest.mark.parametrize(
    ("line", "why"),
    [
        (b"M83", "relative extrusion"),
        (b"G91", "relative moves"),
        (b"G20", "inches"),
        (b"M0 Click", "button"),
        (b"M110 N4", "renumbers"),
        (b"M112", "halt"),
        (b"M0112", "halt"),
        (b"G1 X1*55", "checksum"),
        (b"G1 X\xb5", "can't be sent"),
        (b"M117 " + b"X1 " * 40, r"exceed 96 \(profile: max_line_bytes\)"),
    ],
)
def test_line_that_must_not_be_sent_is_named(line, why):
    with pytest.raises(JobError, match=f"a, line 2: .*{why}"):
        parse_job(b"G90\n" + line + b"\n", "a")


@pytest.mark.parametrize(
    "line",
    [
        "M500",
        "M502",
        "M92 X100",
        "M206 X1",
        "M211 S0",
        "M220 S120",
        "M221 S90",
        "M301 P1",
        "M118 ok",
    ]
    + ["M113 S0", "M28 a.g", "M84\nM201 X99999", "M204 P99999", "M302 S170\nM999"],
)
def test_what_changes_the_firmware_is_refused_by_its_line(line):
    code = line.splitlines()[-1].split()[0]
    with pytest.raises(JobError, match=f"line {2 + line.count(chr(10))}: {code}"):
        parse_job(f"G90\n{line}\nG1 X1\n".encode(), "a")


def test_empty_and_missing_jobs_are_named(tmp_path):
    with pytest.raises(JobError, match="no command"):
        parse_job(b"; nothing\n", "a")
    with pytest.raises(JobError, match="can't be read"):
        load_job(tmp_path / "none.gcode")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(JobError, match="it is a pipe and no regular file"):
        load_job(tmp_path / "pipe")


@given(st.lists(st.tuples(st.sampled_from("XYZEF"), st.integers(-99, 99)), max_size=30))
def test_modal_state_is_that_of_a_walk_forwards(words):
    lines = [f"G1 {axis}{value}".encode() for axis, value in words]
    walked = {axis.lower(): float(value) for axis, value in words}
    assert modal_state(lines, len(lines)) == Modal(**walked)


def test_position_is_compared_axis_by_axis():
    position = parse_position([b"X:1.00 Y:2.00 Z:0.50 E:0.10 Count X:80 Y:160 Z:200"])
    assert position == {"X": 1.0, "Y": 2.0, "Z": 0.5, "E": 0.1}
    assert disagreement(Modal(x=1.004, e=0.1), position) == ""
    assert "X is 1.00 mm where the job says 1.20" in disagreement(Modal(x=1.2), position)
    assert parse_position([b"ok"]) == {}


def test_retreat_relieves_before_it_lifts_and_stays_below_the_top():
    at = Modal(x=1, y=2, z=195, e=3.0, f=600)
    commands = Retreat(relief_mm=0.5, lift_mm=20).leave(at, PRINTER)
    assert commands == [b"G1 E2.50000 F30", b"G1 Z200.00000 F300"]
    back = Retreat().rejoin(at, PRINTER)
    assert back == [b"G1 Z195.00000 F300", b"G1 E3.00000 F30", b"G1 F600"]
    assert Retreat().leave(Modal(), PRINTER) == []


def test_cooling_stays_on_where_the_profile_says_so():
    assert heaters_off(PRINTER) == []
    assert heaters_off(load(Printer, "marlin_avr")) == [b"M104 S0", b"M140 S0"]


def test_what_is_dangerous_goes_off_before_the_heaters():
    lamp = load(Printer, "marlin_avr").model_copy(update={"safe_state_off": ("M106 P1 S0",)})
    assert heaters_off(lamp) == [b"M106 P1 S0", b"M104 S0", b"M140 S0"]
