"""Jobs of a pneumatic head and of Aerotech controllers, each read back by a reader of its own."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from design.errors import ToolpathError
from design.toolpath import MoveBuilder, MoveKind
from design.toolpath.gcode import Gcode, GcodeOptions, write_gcode
from firmware_profiles import FileController, Plunger, Pneumatic, Printer, load
from tests.design.toolpath.plans import PLACE, SYRINGE, embedded, fresh

PRINTER = load(Printer, "pneumatic_marlin")
START, FLOW = (60.0, 70.0, 40.0), 0.12
OPTIONS = GcodeOptions(start_mm=START, flow_ul_s=FLOW)


def head(**changes: Any) -> Printer:
    dispenser = PRINTER.dispenser.model_copy(update=changes)
    return PRINTER.model_copy(update={"dispenser": dispenser})


@dataclass
class Reader:
    """What a patient person would note down: where, how fast, whether the valve is open."""

    at: dict[str, float] = field(default_factory=dict)
    feed: float = 0.0
    is_open: bool | None = None
    stands: bool = False
    written: list[tuple[float, float]] = field(default_factory=list)
    """Length and time of each move with the valve open."""
    travels_open: int = 0
    switched_moving: int = 0
    dwell: float = 0.0
    lines: list[str] = field(default_factory=list)

    def read(self, data: bytes) -> Reader:
        self.lines = data.decode().split("\n")[:-1]
        for line in self.lines:
            code, *words = line.split(" ")
            values = {word[0]: float(word[1:]) for word in words if word[1:]}
            if code in ("M106",):
                self.switched_moving += not self.stands
                self.is_open = values["S"] > 0
            elif code in ("M400", "G4"):
                self.stands = True
            elif code in ("G0", "G1"):
                self._move(code, values)
            elif code == "G92":
                self.at |= values
        return self

    def _move(self, code: str, values: dict[str, float]) -> None:
        self.feed = values.pop("F", self.feed)
        assert set(values) <= set("XYZ")
        way = [values[axis] - self.at.get(axis, 0.0) for axis in values]
        length = float(np.linalg.norm(way))
        self.at |= values
        self.stands = False
        if self.is_open:
            self.travels_open += code == "G0"
            self.written.append((length, length / (self.feed / 60)))


@pytest.mark.parametrize("make", [fresh, embedded])
def test_every_written_move_lays_its_volume_by_time(make: Any) -> None:
    toolpath = make()
    options = OPTIONS
    gcode = write_gcode(toolpath, PRINTER, SYRINGE, PLACE, options)
    found = Reader().read(gcode.data)
    seconds = np.array([time for _, time in found.written])
    writes = toolpath.kind == MoveKind.WRITE
    assert FLOW * seconds.sum() == pytest.approx(toolpath.volume_ul[writes].sum(), rel=1e-3)
    # Move by move: what was merged is summed.
    ends = gcode.line_move[gcode.line_move >= 0]
    ends = ends[toolpath.kind[ends] == MoveKind.WRITE]
    laid = np.cumsum(np.where(writes, toolpath.volume_ul, 0))[ends]
    np.testing.assert_allclose(FLOW * seconds, np.diff(laid, prepend=0.0), rtol=2e-3)


@pytest.mark.parametrize("make", [fresh, embedded])
def test_valve_is_closed_for_travels_and_switched_only_while_the_head_stands(make: Any) -> None:
    found = Reader().read(
        write_gcode(make(), PRINTER, SYRINGE, PLACE, GcodeOptions(flow_ul_s=FLOW)).data
    )
    assert found.travels_open == 0
    assert found.is_open is False
    # The header's first close comes before anything moves.
    assert found.switched_moving == 1
    assert found.lines[1] == "M106 P0 S0"
    assert sum(line == "M106 P0 S255" for line in found.lines) > 2


def test_valve_is_closed_where_a_job_may_be_interrupted() -> None:
    lines = lines_of(write_gcode(fresh(), PRINTER, SYRINGE, PLACE, OPTIONS))
    is_open, marks = False, 0
    for line in lines:
        if line.startswith("M106"):
            is_open = line.endswith("S255")
        if line.startswith(";"):
            marks += 1
            assert not is_open
    assert marks >= 5


@pytest.mark.parametrize("firmware", ["marlin", "prusa", "reprapfirmware", "klipper"])
def test_every_family_takes_its_own_valve_s_words(firmware: str) -> None:
    words = {"opens": "SET_PIN PIN=air VALUE=1", "closes": "SET_PIN PIN=air VALUE=0"}
    changes = words if firmware == "klipper" else {"opens": "M42 P4 S255", "closes": "M42 P4 S0"}
    printer = head(**changes).model_copy(update={"firmware": firmware})
    gcode = write_gcode(fresh(), printer, SYRINGE, PLACE, OPTIONS)
    text = gcode.data.decode()
    assert text.count(changes["opens"]) + 1 == text.count(changes["closes"])
    assert len(gcode.line_move) == text.count("\n") == len(gcode.line_source)
    assert not any(code in text for code in ("M302", "M82", "M221", "M200"))
    assert gcode.line_count == text.count("\n") - text.count(";")


@pytest.mark.parametrize(
    ("flow", "changes", "says"),
    [
        (3.0, {}, r"layer 0, to \(3\.925, .* mm of the part: at 3 µL/s .*max_speed_mm_s\.x"),
        (FLOW, {"ink_speed_mm_s": (1.0, 10.0)}, r"14\.5\d* mm/s are outside 1 to 10"),
        (0.001, {"ink_speed_mm_s": (1.0, 10.0)}, "0.121.* mm/s are outside 1 to 10"),
        (None, {}, "nobody said its flow"),
    ],
)
def test_a_speed_that_nothing_bears_is_refused(flow, changes, says):
    with pytest.raises(ToolpathError, match=says):
        write_gcode(fresh(), PRINTER, SYRINGE, PLACE, GcodeOptions(flow_ul_s=flow, **changes))


def test_standing_doses_open_the_valve_each_for_its_time() -> None:
    builder = MoveBuilder((0, 0, 0), "layer")
    for dose in (10.0, 20.0):
        builder.plunge(dose, 2.0, 0)
    builder.dwell(1.0, -1)
    path = builder.build(must_write=False)
    options = GcodeOptions(start_mm=START, flow_ul_s=1.0, standing_doses=True)
    lines = write_gcode(path, PRINTER, SYRINGE, PLACE, options).data.decode().split("\n")
    opened = [at for at, line in enumerate(lines) if line == "M106 P0 S255"]
    assert [lines[at + 1 : at + 3] for at in opened] == [
        ["G4 P30", "G4 P5000"],
        ["G4 P30", "G4 P10000"],
    ]


def test_valve_waits_its_delays() -> None:
    slow = head(opening_delay_s=0.1234, closing_delay_s=0.0)
    lines = lines_of(write_gcode(fresh(), slow, SYRINGE, PLACE, OPTIONS))
    at = lines.index("M106 P0 S255")
    assert lines[at - 1 : at + 2] == ["M400", "M106 P0 S255", "G4 P124"]
    shut = lines.index("M106 P0 S0", at)
    assert lines[shut - 1] == "M400"
    assert not lines[shut + 1].startswith("G4")


# Aerotech controllers.


A3200 = load(Printer, "aerotech_pneumatic")
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


def lines_of(gcode: Gcode) -> list[str]:
    lines = gcode.data.decode().split("\n")[:-1]
    assert len(lines) == len(gcode.line_source) == len(gcode.line_move) == len(gcode.line_kind)
    assert gcode.line_count == sum(not line.startswith(("//", ";")) for line in lines)
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
