"""What may be typed, and which way it goes."""

from __future__ import annotations

import pytest

from firmware_profiles import Printer, load
from printctl.link.errors import Refused
from printctl.station.console import read_typed

MARLIN = load(Printer, "generic_marlin")
KLIPPER = load(Printer, "klipper_bioprinter")
PNEUMATIC = load(Printer, "pneumatic_marlin")


@pytest.mark.parametrize(
    ("text", "wish", "values"),
    [
        ("G1 X10 Y-2.5 F600", "move_to", {"x": 10.0, "y": -2.5, "speed_mm_s": 10.0}),
        ("g01Z5", "move_to", {"z": 5.0}),
        ("G28 X Y", "home", {"axes": ["x", "y"]}),
        ("G28", "home", {"axes": ["x", "y", "z"]}),
        ("M104 S37", "heat", {"name": "nozzle", "celsius": 37.0}),
        ("M0140S30", "heat", {"name": "bed", "celsius": 30.0}),
        ("M104 T1 S20", "heat", {"name": "nozzle 1", "celsius": 20.0}),
        ("M114", "raw", {}),
        ("M503", "raw", {}),
    ],
)
def test_moves_and_heat_go_by_their_limits(text, wish, values):
    typed = read_typed(text, MARLIN)
    assert (typed.wish, dict(typed.values)) == (wish, values)


@pytest.mark.parametrize(
    "text",
    ["G1 E5", "G2 X1 I1", "G29", "M109 S40", "M303 S200", "M104", "M104 R40", "M500", "G92 X0"]
    + ["M84", "M112", "M410", "M083", "N1 G28", "", "G28*1", "M114\nG28", "M114\x07", "é"],
)
def test_what_would_go_past_the_limits_is_refused(text):
    with pytest.raises(Refused):
        read_typed(text, MARLIN)


def test_a_macro_of_klipper_may_do_anything_and_is_refused():
    assert read_typed("STATUS", KLIPPER).wish == "raw"
    with pytest.raises(Refused, match="macros"):
        read_typed("LOAD_INK", KLIPPER)


def test_a_valve_isnt_opened_by_the_console():
    with pytest.raises(Refused, match="valve"):
        read_typed("M106 P0 S255", PNEUMATIC)
    assert read_typed("M106 P0 S255", MARLIN).wish == "raw"
