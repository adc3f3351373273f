"""Commanded state after some lines of a job: position, relief, settings."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printctl.machine.link.modal import Modal, ModalTrail, modal_state, relieved_mm


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ([], 0.0),
        ([b"G1 E1", b"G1 E0.75 F60", b"G0 Z5"], 0.25),
        ([b"G1 E1", b"G1 X1 E1.5"], 0.0),
        ([b"G1 E1", b"G1 E0.75", b"G1 E1"], 0.0),
        ([b"G1 E5", b"G92 E0", b"G0 X1"], 0.0),
        ([b"G1 E5", b"G92 E0", b"G1 E-0.25"], 0.25),
        ([b"G1 E1", b"G1 E0.75", b"G0 X1 Y1", b"M105", b"G1 F600"], 0.25),
        ([b"G1 E1"], 0.0),
    ],
)
def test_relief_of_the_job_itself_is_found(lines, expected):
    assert relieved_mm(lines, len(lines)) == pytest.approx(expected)


WORDS = st.lists(st.sampled_from("XYZEF"), max_size=3, unique=True)
LINES = st.tuples(st.sampled_from(["G1", "G0", "G92", "G28", "M105"]), WORDS, st.integers(0, 9))


@given(st.lists(LINES, max_size=30), st.lists(st.integers(0, 30), max_size=8))
def test_trail_is_the_modal_state_at_every_line_forwards_and_back(lines, asked):
    job = [" ".join([code, *(f"{w}{at}" for w in words)]).encode() for code, words, at in lines]
    trail = ModalTrail(job)
    for done in asked:
        assert trail.at(min(done, len(job))) == modal_state(job, min(done, len(job)))


def test_a_place_told_by_a_command_with_a_name_counts():
    lines = [b"SET_KINEMATIC_POSITION X=100 Y=90 Z=20", b"G92 E0", b"G1 X101 E1 F600"]
    assert modal_state(lines, 2) == Modal(100, 90, 20, 0)
    assert modal_state(lines, 3) == Modal(101, 90, 20, 1, 600)
    lines += [b"SET_KINEMATIC_POSITION Z=5"]
    assert ModalTrail(lines).at(4) == Modal(101, 90, 5, 1, 600)
