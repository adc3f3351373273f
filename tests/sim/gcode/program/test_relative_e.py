"""Commands that make E relative, in each firmware family.

Sources: Marlin bugfix-2.1.x and Klipper (84104bbb) themselves, 2026-11-22, by their M114 after each
line; RepRapFirmware's G-code dictionary (G91: "extrusion is NOT set to relative using G91");
Prusa-Firmware's ``Marlin_main.cpp`` ("E axis is left intact").
"""

from __future__ import annotations

import pytest

from firmware_profiles import Printer, load
from sim.gcode.program.read_program import read_written

LINES = (
    *("G90", "M82", "G1 E1", "G91", "G1 E1", "M82", "G1 E1", "G91", "G90", "G1 E2"),
    *("M83", "G1 E1", "G90", "G1 E1", "G91", "M83", "G90", "M82", "G1 E0"),
)
ENDS = {
    "marlin": [1, 2, 1, 2, 3, 1, 0],
    "klipper": [1, 2, 3, 2, 3, 4, 0],
    "reprapfirmware": [1, 1, 1, 2, 3, 4, 0],
    "prusa": [1, 1, 1, 2, 3, 4, 0],
}


@pytest.mark.parametrize("family", sorted(ENDS))
def test_e_is_relative_as_the_firmware_has_it(family: str) -> None:
    printer = load(Printer, "generic_marlin").model_copy(update={"firmware": family})
    program = read_written("\n".join(LINES).encode() + b"\n", printer, (0.0, 0.0, 0.0)).program
    moves = [line for line, text in enumerate(LINES, 1) if text.startswith("G1")]
    places = [float(program.target[program.line == line][-1, 3]) for line in moves]
    assert places == ENDS[family]
