"""Jobs for Aerotech controllers, read back line by line by a reader of their own."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from design.errors import ToolpathError
from design.toolpath import MoveKind, Toolpath
from design.toolpath.embedded import EmbeddedOptions
from design.toolpath.fresh import FreshOptions
from design.toolpath.gcode import Gcode, GcodeOptions, write_gcode
from firmware_profiles import FileController, Plunger, Pneumatic, Printer, Syringe, load
from tests.design.toolpath.plans import embedded_toolpath, fresh_toolpath
from tests.design.toolpath.shapes import as_solid, block, random_tree, upright

A3200, SYRINGE = load(Printer, "aerotech_pneumatic"), load(Syringe, "hamilton_1ml")
PLACE, START, FLOW = np.array([60.0, 70.0, 20.0]), (60.0, 70.0, 40.0), 0.12
OPTIONS = GcodeOptions(start_mm=START, flow_ul_s=FLOW)
ALLOWED = re.compile(
    r"G1( [XYZAF]-?\d+(\.\d+)?)+|G4 P\d+(\.\d+)?|G71|G76|G90|G92( [XYZA]-?\d+(\.\d+)?)+|"
    r"VELOCITY ON|G108|WAIT MOVEDONE X Y Z( A)?|WaitForMotionDone\(\[X, Y, Z(, A)?\]\)|"
    r"\$DO\[0\]\.X=[01]|DigitalOutputSet\(X, 0, [01]\)|//(LAYER_END:\d+|PASS_END:\d+|RELOAD)"
)


def automation1() -> Printer:
    head = A3200.dispenser.model_copy(
        update={"opens": "DigitalOutputSet(X, 0, 1)", "closes": "DigitalOutputSet(X, 0, 0)"}
    )
    chosen = FileController(controller="automation1")
    return A3200.model_copy(update={"dispenser": head, "file_controller": chosen})


def plunger(controller: Any = "a3200") -> Printer:
    chosen = FileController(controller=controller, plunger_axis="A")
    update = {"dispenser": Plunger(), "plunger_travel_mm": 60.0, "file_controller": chosen}
    return A3200.model_copy(update=update)


def fresh() -> Toolpath:
    return fresh_toolpath(as_solid(block(4, 3, 0.3) - upright(2, 1.5, 1)), FreshOptions())


def embedded() -> Toolpath:
    return embedded_toolpath(random_tree(20, 10, 3, 0.1), EmbeddedOptions())


def lines_of(gcode: Gcode) -> list[str]:
    lines = gcode.data.decode().split("\n")[:-1]
    assert len(lines) == len(gcode.line_source) == len(gcode.line_move) == len(gcode.line_kind)
    assert gcode.line_count == sum(not line.startswith("//") for line in lines)
    return lines


def words_of(line: str) -> dict[str, float]:
    return {word[0]: float(word[1:]) for word in line.split(" ")[1:]}


@pytest.mark.parametrize("make", [fresh, embedded])
@pytest.mark.parametrize("printer", [A3200, automation1(), plunger(), plunger("automation1")])
def test_nothing_is_said_that_the_controller_may_not_know(make: Any, printer: Printer) -> None:
    lines = lines_of(write_gcode(make(), printer, SYRINGE, PLACE, OPTIONS))
    assert [line for line in lines if not ALLOWED.fullmatch(line)] == []
    assert any(line.startswith("//") for line in lines)


@pytest.mark.parametrize(
    ("printer", "header", "footer"),
    [
        (
            A3200,
            ["$DO[0].X=0", "G71", "G76", "G90", "VELOCITY ON", "G92 X60 Y70 Z40"],
            "WAIT MOVEDONE X Y Z",
        ),
        (
            automation1(),
            ["DigitalOutputSet(X, 0, 0)", "G71", "G76", "G90", "G108", "G92 X60 Y70 Z40"],
            "WaitForMotionDone([X, Y, Z])",
        ),
        (
            plunger(),
            ["G71", "G76", "G90", "VELOCITY ON", "G92 X60 Y70 Z40 A0"],
            "WAIT MOVEDONE X Y Z A",
        ),
        (
            plunger("automation1"),
            ["G71", "G76", "G90", "G108", "G92 X60 Y70 Z40 A0"],
            "WaitForMotionDone([X, Y, Z, A])",
        ),
    ],
)
def test_units_and_modes_are_stated(printer: Printer, header: list[str], footer: str) -> None:
    lines = lines_of(write_gcode(fresh(), printer, SYRINGE, PLACE, OPTIONS))
    assert lines[: len(header)] == header
    assert lines[-1] == footer


@pytest.mark.parametrize("make", [fresh, embedded])
@pytest.mark.parametrize("printer", [A3200, automation1()])
def test_the_valve_switches_standing_and_each_path_lays_its_volume(make, printer):
    toolpath, head = make(), printer.pneumatic
    assert isinstance(head, Pneumatic)
    at, feed, seconds, is_open = dict(zip("XYZ", START, strict=True)), 0.0, 0.0, False
    lines = lines_of(write_gcode(toolpath, printer, SYRINGE, PLACE, OPTIONS))
    for number, line in enumerate(lines):
        if line in (head.opens, head.closes):
            is_open = line == head.opens
            assert number == 0 or lines[number - 1].upper().startswith("WAIT")
            assert number == 0 or lines[number + 1] == "G4 P0.03"
        elif line.startswith("G1"):
            words = words_of(line)
            feed = words.pop("F", feed)
            way = float(np.linalg.norm([words[axis] - at[axis] for axis in words]))
            at |= words
            seconds += way / feed if is_open else 0.0
        elif line.startswith("//"):
            assert not is_open
    assert not is_open
    writes = toolpath.kind == MoveKind.WRITE
    assert FLOW * seconds == pytest.approx(toolpath.volume_ul[writes].sum(), rel=1e-3)


@pytest.mark.parametrize("make", [fresh, embedded])
def test_the_moves_are_those_of_a_marlin_with_the_same_axes(make: Any) -> None:
    """Places, plunger and speeds: only letters and units differ."""
    printer = plunger()
    marlin = printer.model_copy(update={"firmware": "marlin", "file_controller": None})
    ours = lines_of(write_gcode(make(), printer, SYRINGE, PLACE, OPTIONS))
    theirs = write_gcode(make(), marlin, SYRINGE, PLACE, OPTIONS).data.decode().split("\n")
    moves = [words_of(line) for line in ours if line.startswith("G1 ")]
    wanted = [words_of(line.replace("E", "A")) for line in theirs if line[:2] in ("G0", "G1")]
    # F is left out where it is that of the move before, to the last digit of either.
    feeds = [0.0, 0.0]
    for one, other in zip(moves, wanted, strict=True):
        feeds = [one.pop("F", feeds[0]), other.pop("F", feeds[1])]
        assert feeds[0] == pytest.approx(feeds[1] / 60, abs=3e-5)
        assert one == other


def test_a_long_job_counts_the_plunger_through() -> None:
    """These controllers count in more than a float32: no break in the motion for it."""
    syringe = SYRINGE.model_copy(update={"inner_mm": 0.2})
    marlin = plunger().model_copy(update={"firmware": "marlin", "file_controller": None})
    data = [write_gcode(fresh(), of, syringe, PLACE, OPTIONS).data for of in (plunger(), marlin)]
    assert data[0].count(b"G92") == 1 < data[1].count(b"G92")


def test_a_profile_that_doesnt_say_its_controller_is_refused() -> None:
    unsaid = A3200.model_copy(update={"file_controller": None})
    with pytest.raises(ToolpathError, match="which Aerotech controller"):
        write_gcode(fresh(), unsaid, SYRINGE, PLACE, OPTIONS)
