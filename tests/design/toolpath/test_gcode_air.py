"""A pneumatic head's G-code, read back line by line by a reader of its own."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from design.errors import ToolpathError
from design.toolpath import MoveBuilder, MoveKind, Toolpath
from design.toolpath.embedded import EmbeddedOptions
from design.toolpath.fresh import FreshOptions
from design.toolpath.gcode import GcodeOptions, write_gcode
from firmware_profiles import Printer, Syringe, load
from tests.design.toolpath.plans import embedded_toolpath, fresh_toolpath
from tests.design.toolpath.shapes import as_solid, block, random_tree, upright

PRINTER, SYRINGE = load(Printer, "pneumatic_marlin"), load(Syringe, "hamilton_1ml")
PLACE = np.array([60.0, 70.0, 20.0])
FLOW = 0.12
START = (60.0, 70.0, 40.0)


def head(**changes: Any) -> Printer:
    dispenser = PRINTER.dispenser.model_copy(update=changes)
    return PRINTER.model_copy(update={"dispenser": dispenser})


def fresh() -> Toolpath:
    return fresh_toolpath(as_solid(block(4, 3, 0.3) - upright(2, 1.5, 1)), FreshOptions())


def embedded() -> Toolpath:
    return embedded_toolpath(random_tree(20, 10, 3, 0.1), EmbeddedOptions())


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
    options = GcodeOptions(start_mm=START, flow_ul_s=FLOW)
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
    lines = (
        Reader()
        .read(write_gcode(fresh(), PRINTER, SYRINGE, PLACE, GcodeOptions(flow_ul_s=FLOW)).data)
        .lines
    )
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
    gcode = write_gcode(
        fresh(), printer, SYRINGE, PLACE, GcodeOptions(start_mm=START, flow_ul_s=FLOW)
    )
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
    lines = (
        Reader()
        .read(write_gcode(fresh(), slow, SYRINGE, PLACE, GcodeOptions(flow_ul_s=FLOW)).data)
        .lines
    )
    at = lines.index("M106 P0 S255")
    assert lines[at - 1 : at + 2] == ["M400", "M106 P0 S255", "G4 P124"]
    shut = lines.index("M106 P0 S0", at)
    assert lines[shut - 1] == "M400"
    assert not lines[shut + 1].startswith("G4")
