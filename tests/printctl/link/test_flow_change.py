"""Ink of the rest of a job, scaled."""

import pytest

from printctl.link.flow_change import scaled_lines

LINES = [
    b"G92 E0",
    b"G1 X1 E1 F600",
    b"G1 E0.5",
    b"G1 X2 Y3",
    b"G1 E1",
    b"G1 X3 E2.00000",
    b"G1 X4 E1.9 F60",
    b"M105",
    b"G92 E10",
    b"G1 X5 E11",
]


def test_writing_moves_behind_a_line_are_scaled_and_nothing_else():
    assert scaled_lines(LINES[2:], 1.0, 1.5) == [
        b"G1 E0.50000",
        b"G1 X2 Y3",
        b"G1 E1.00000",
        b"G1 X3 E2.50000",
        b"G1 X4 E2.40000 F60",
        b"M105",
        b"G92 E10",
        b"G1 X5 E11.50000",
    ]


def test_two_changes_are_one_after_the_other():
    twice = scaled_lines(scaled_lines(LINES, 0.0, 2.0), 0.0, 0.5)
    assert [float(line.partition(b" E")[2].split()[0]) for line in twice if b" E" in line] == [
        float(line.partition(b" E")[2].split()[0]) for line in LINES if b" E" in line
    ]


def test_many_lines_sum_up_without_drift():
    lines = [b"G1 X%d E%.5f" % (k, 0.00333 * (k + 1)) for k in range(10_000)]
    last = scaled_lines(lines, 0.0, 1.1)[-1]
    assert float(last.partition(b" E")[2]) == pytest.approx(0.00333 * 10_000 * 1.1, abs=1e-5)
