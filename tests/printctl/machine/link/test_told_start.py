"""Declared tip position (G92) in a job's first lines."""

from __future__ import annotations

import pytest

from printctl.machine.link.errors import LinkError
from printctl.machine.link.job_start import declared_start
from tests.printctl.machine.link.jobs import parse_job

PLACE = (100.0, 90.0, 50.0)


def told(*lines: str) -> tuple[float, float, float] | None:
    return declared_start(parse_job("\n".join(lines).encode() + b"\n", "job.gcode"))


@pytest.mark.parametrize(
    "lines",
    [
        ["G92 X100 Y90 Z50 E0", "G1 X101 F600"],
        ["G92 X100 Y90", "G92 Z50", "G1 X101 F600"],
        ["G92 X100 Y90 Z50", "G92 Z20", "G1 X101 F600"],
        ["G92 X100 Y90 Z50", "G1 X101 F600", "G92 Z50", "G1 X250"],
        ["G92 X100 Y90 Z50", "G1 X101 F600", "G92 X0 Y0 Z0", "G1 X120"],
    ],
)
def test_the_first_word_of_each_axis_before_any_move_counts(lines):
    assert told(*lines) == PLACE


@pytest.mark.parametrize(
    "lines",
    [["G92 X100 Y90", "G1 X101 F600"], ["G1 X101 F600", "G92 X0 Y0 Z0", "G1 X1"]],
)
def test_a_place_that_is_told_in_part_or_late_is_refused(lines):
    with pytest.raises(LinkError, match=r"G92 X.* tells the printer where the tip stands"):
        told(*lines)


@pytest.mark.parametrize(
    "lines",
    [
        ["G92 E0", "G1 X1 Z2 F60", "G92 Z2"],
        ["G92 E0", "G1 X1 F60"],
        ["G28", "G92 X5 Y5 Z0", "G1 X1 F60"],
    ],
)
def test_a_job_that_tells_none_or_homes_begins_where_it_is_said_to(lines):
    assert told(*lines) is None
