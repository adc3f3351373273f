"""Printed lines read from G-code."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_profiles.bead import BeadSection
from printctl.checks.lumens import read_lines
from printctl.errors import UsageError
from tests.printctl.checks.lumens.small_gcode import LAYER_MM, LINE_MM, UL_PER_E, gcode, tube


def test_a_line_is_as_wide_as_its_volume_says() -> None:
    lines = read_lines(gcode([tube(0.3), tube(0.3)]), UL_PER_E)
    assert lines.width == pytest.approx(LINE_MM, abs=2e-5)
    assert lines.low == pytest.approx([0, LAYER_MM])
    assert lines.high == pytest.approx([LAYER_MM, 2 * LAYER_MM])


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
