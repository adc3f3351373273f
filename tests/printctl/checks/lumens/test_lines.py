"""Printed lines read from G-code."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_profiles.bead import BeadSection
from printctl.checks.lumens import read_lines, rounded_to_steps
from printctl.errors import UsageError
from tests.printctl.checks.lumens.small_gcode import LAYER_MM, LINE_MM, UL_PER_E, gcode, tube


def test_a_line_is_as_wide_as_its_volume_says() -> None:
    lines = read_lines(gcode([tube(0.3), tube(0.3)]), UL_PER_E)
    assert lines.width == pytest.approx(LINE_MM, abs=2e-5)
    assert lines.low == pytest.approx([0, LAYER_MM])
    assert lines.high == pytest.approx([LAYER_MM, 2 * LAYER_MM])


def test_few_digits_of_e_hardly_change_a_line() -> None:
    lines = read_lines(gcode([tube(0.3), tube(0.3)], decimals=5), UL_PER_E)
    short = np.linalg.norm(lines.end - lines.start, axis=1).min()
    assert 0.5e-5 * UL_PER_E / (short * LAYER_MM) > 0.01 * LINE_MM  # of a move by itself
    assert lines.width == pytest.approx(LINE_MM, rel=0.01)


def test_a_stroke_shorter_than_wide_is_a_dot_of_its_volume() -> None:
    data = b"G0 Z0.06\nG1 X0.01 E0.001\nG0 X1\nG0 Z0.12\nG1 X2 E0.01\n"
    lines = read_lines(data, UL_PER_E)
    area = np.pi / 4 * lines.width[0] ** 2
    assert area * LAYER_MM == pytest.approx(0.001 * UL_PER_E)


def test_relative_e_and_a_reset_say_the_same() -> None:
    absolute = b"M82\nG0 Z0.06\nG1 X1 E0.01\nG1 X2 E0.02\nG0 Z0.12\nG1 X0 E0.04\n"
    relative = b"M83\nG0 Z0.06\nG1 X1 E0.01\nG92 E5\nG1 X2 E0.01\nG0 Z0.12\nG1 X0 E0.02\n"
    one, other = (read_lines(data, UL_PER_E) for data in (absolute, relative))
    assert one.width == pytest.approx(other.width)
    assert one.end == pytest.approx(other.end)


def test_the_ink_s_bead_says_how_wide_a_line_is() -> None:
    data = gcode([tube(0.3), tube(0.3)])
    mean = LINE_MM - LAYER_MM * (1 - np.pi / 4)
    for model, width in (("rectangle", mean), ("ellipse", mean * 4 / np.pi), (20.0, mean + 0.02)):
        found = read_lines(data, UL_PER_E, bead=BeadSection(model)).width
        assert found == pytest.approx(width, abs=2e-5)


def test_a_fixed_width_needs_no_meaning_of_e() -> None:
    data = gcode([tube(0.3), tube(0.3)])
    assert (read_lines(data, None, line_mm=0.2).width == 0.2).all()
    with pytest.raises(UsageError, match="what one E means"):
        read_lines(data, None)


def test_positions_are_those_that_the_file_writes_after_g92() -> None:
    layers = [tube(0.3, centre=(100, 50)), tube(0.3, centre=(100, 50))]
    lines = read_lines(gcode(layers, head="G92 X100 Y50 Z20 E0"), UL_PER_E)
    middle = lines.bounds.mean(axis=0)
    assert middle == pytest.approx([100, 50, LAYER_MM])


def test_a_layer_over_nothing_has_the_usual_thickness() -> None:
    layers = [tube(0.3), tube(0.3), [], [], tube(0.3)]
    lines = read_lines(gcode(layers), UL_PER_E)
    assert lines.high - lines.low == pytest.approx(LAYER_MM)
    assert lines.width == pytest.approx(LINE_MM, abs=2e-5)


def test_one_layer_asks_for_its_thickness() -> None:
    with pytest.raises(UsageError, match="--layer-um"):
        read_lines(gcode([tube(0.3)]), UL_PER_E)
    assert read_lines(gcode([tube(0.3)]), UL_PER_E, layer_mm=LAYER_MM).width == pytest.approx(
        LINE_MM, abs=2e-5
    )


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"G0 X1\nG0 X2\n", "no move"),
        (b"G1 X1 Z1 E1\nG1 X2 Z2 E2\n", "line 1 writes from z 0 to 1"),
        (b"G0 Z0.06\nG1 X1 E9\nG0 Z0.12\nG1 X2 E99\n", "check what E means"),
    ],
)
def test_what_cant_be_read_is_refused(data: bytes, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        read_lines(data, UL_PER_E)


def test_steps_move_ends_to_whole_steps_and_keep_widths() -> None:
    lines = read_lines(gcode([tube(0.3), tube(0.3)]), UL_PER_E)
    stepped = rounded_to_steps(lines, (10.0, 20.0))
    assert np.allclose(stepped.start * [10, 20], np.rint(stepped.start * [10, 20]))
    assert np.abs(stepped.start - lines.start).max() <= 0.05
    assert (stepped.width == lines.width).all()
