"""Start and end G-code of a job, for each firmware family."""

from __future__ import annotations

import pytest

from design.toolpath.fresh import FreshOptions
from design.toolpath.gcode import GcodeOptions, write_gcode
from firmware_profiles import Printer, Syringe, load
from tests.design.toolpath.plans import fresh_toolpath
from tests.design.toolpath.shapes import as_solid, block

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
    gcode = write_gcode(toolpath, printer, load(Syringe, "hamilton_1ml"), (60, 70, 20), options)
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
