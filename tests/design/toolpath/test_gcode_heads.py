"""Two-head jobs: active plunger, tip positions, head changes."""

from dataclasses import replace

import numpy as np
import pytest

from design.errors import ToolpathError
from design.toolpath.gcode import GcodeOptions, HeadLoad, write_gcode
from design.toolpath.toolpath import MoveBuilder
from firmware_profiles import Printer, Syringe, load
from gcode.dry_run.run import dry_run

TWO = load(Printer, "two_syringe_marlin")
ONE = load(Printer, "generic_marlin")
SMALL, LARGE = load(Syringe, "hamilton_1ml"), load(Syringe, "hamilton_2_5ml")
PLACE = np.array([60.0, 70.0, 5.0])
OPTIONS = GcodeOptions(
    start_mm=(60.0, 70.0, 30.0), heads=(HeadLoad(SMALL), HeadLoad(LARGE)), safe_z_mm=25.0
)
OFFSET = np.array([40.0, 0.0, 0.0])


def lines_of(points, tools, *, relieves=True):
    """A straight line of 1 µL per entry, each with a lift, a travel and a prime before it."""
    builder, tool = MoveBuilder(np.array(points[0][0]), "vessel"), []

    def mark(number):
        tool.extend([number] * (sum(len(run.end) for run in builder._runs) - len(tool)))

    for number, ((begin, end), head) in enumerate(zip(points, tools, strict=True)):
        if number:
            if relieves:
                builder.plunge(-0.02, 0.4, number)
                mark(tools[number - 1])
            up = np.array([*builder.tip[:2], 4.0])
            across = np.array([*begin[:2], 4.0])
            builder.travel(np.array([up, across, begin]), 20.0, number)
            mark(head)
            if relieves and head in tools[:number]:
                builder.plunge(0.02, 0.4, number)
        builder.write(np.array([end]), np.array([1.0]), 5.0, number)
        mark(head)
    built = builder.build()
    return replace(built, tool=np.array(tool, dtype=np.int64))


LINES = [((k, k, 1.0), (k + 3.0, k, 1.0)) for k in range(4)]
PATH = lines_of(LINES, [0, 1, 1, 0])


class Replay:
    """Reads a job by itself: place of the carriage, plunger of each head, which are raised."""

    def __init__(self, data: bytes) -> None:
        self.at = dict.fromkeys("XYZE", 0.0)
        self.head, self.raised = None, set()
        self.pushed = {0: 0.0, 1: 0.0}
        self.strokes, self.rows, self.changes = [], [], 0
        for text in data.decode().splitlines():
            self.take(text)

    def take(self, text: str) -> None:
        name, *rest = text.split()
        words = {word[0]: word[1:] for word in rest}
        if name in ("T0", "T1"):
            assert words == {"S": "1"}
            self.changes += self.head not in (None, int(name[1]))
            self.head = int(name[1])
        elif name == "M280":
            (self.raised.add if words["S"] == "90" else self.raised.discard)(int(words["P"]))
        elif name == "G92":
            self.at |= {axis: float(value) for axis, value in words.items()}
        elif name in ("G0", "G1"):
            before = dict(self.at)
            self.at |= {axis: float(words[axis]) for axis in "XYZE" if axis in words}
            pushed = self.at["E"] - before["E"]
            if self.head is not None:
                self.pushed[self.head] += pushed
            tip = [np.array([place[axis] for axis in "XYZ"]) for place in (before, self.at)]
            self.rows.append((text, tip, self.head, set(self.raised)))
            if pushed > 0 and np.ptp(tip, axis=0).any():
                self.strokes.append((self.head, *tip, pushed))


def test_a_job_of_one_head_is_what_it_was():
    path = replace(PATH, tool=np.zeros_like(PATH.tool))
    plain = write_gcode(path, ONE, SMALL, PLACE, GcodeOptions(start_mm=(60, 70, 30)))
    assert b"\nT" not in plain.data
    assert b"M218" not in plain.data
    assert plain.data.count(b"M400") == 1


def test_each_line_is_written_by_its_head_and_the_dry_run_finds_nothing_wrong():
    job = Replay(write_gcode(PATH, TWO, SMALL, PLACE, OPTIONS).data)
    assert [head for head, *_ in job.strokes] == [0, 1, 1, 0]
    for (head, begin, end, pushed), (first, last) in zip(job.strokes, LINES, strict=True):
        offset = OFFSET * head
        np.testing.assert_allclose(begin + offset - PLACE, first, atol=1e-9)
        np.testing.assert_allclose(end + offset - PLACE, last, atol=1e-9)
        bore = (SMALL, LARGE)[head].inner_mm
        assert pushed == pytest.approx(4 / (np.pi * bore**2), abs=1e-4)
    for head, syringe in enumerate((SMALL, LARGE)):
        per_ul = 4 / (np.pi * syringe.inner_mm**2)
        volume = PATH.volume_ul[PATH.tool == head].sum()
        ends_here = head == 0  # the last one is relieved once more
        assert job.pushed[head] == pytest.approx((volume - 0.02 * ends_here) * per_ul, abs=1e-4)
    run = dry_run(write_gcode(PATH, TWO, SMALL, PLACE, OPTIONS).data, TWO, (60, 70, 30))
    assert run.findings == []
    for head, syringe in enumerate((SMALL, LARGE)):
        area = np.pi / 4 * syringe.inner_mm**2
        written = PATH.volume_ul[PATH.tool == head].sum()
        assert run.of_head(head).plunger_max_mm * area == pytest.approx(written, rel=0.05)


def test_heads_are_changed_above_everything_with_the_idle_one_raised():
    job = Replay(write_gcode(PATH, TWO, SMALL, PLACE, OPTIONS).data)
    assert job.changes == 2
    state = None
    for text, (before, after), head, raised in job.rows:
        assert len(raised) == 1
        if head is not None:
            assert 1 - head in raised, text
        if (head, frozenset(raised)) != state:
            assert before[2] >= 25.0 or state is None, text
            state = head, frozenset(raised)
        level = np.ptp([before, after], axis=0)
        if level[:2].any() and max(before[2], after[2]) > PLACE[2] + 4.0:
            assert min(before[2], after[2]) >= 25.0  # only straight up and down beside the part


def test_what_the_toolpath_doesn_t_relieve_the_writer_does_and_primes_again():
    path = lines_of(LINES, [0, 1, 1, 0], relieves=False)
    data = write_gcode(path, TWO, SMALL, PLACE, OPTIONS).data
    job = Replay(data)
    assert [head for head, *_ in job.strokes] == [0, 1, 1, 0]
    per_ul = 4 / (np.pi * SMALL.inner_mm**2)
    for _, _, _, pushed in (job.strokes[0], job.strokes[3]):
        assert pushed == pytest.approx(per_ul, abs=1e-4)
    assert job.pushed[0] == pytest.approx((2 - 0.02) * per_ul, abs=1e-4)


def test_the_firmware_is_told_to_add_no_offset_before_any_move():
    lines = write_gcode(PATH, TWO, SMALL, PLACE, OPTIONS).data.decode().splitlines()
    first = next(k for k, text in enumerate(lines) if text.startswith("G0"))
    for needed in ("M218 T1 X0 Y0 Z0", "M280 P1 S90", "T0 S1"):
        assert needed in lines[:first]
    assert lines.index("M218 T1 X0 Y0 Z0") < lines.index("T0 S1")
    for number, text in enumerate(lines):
        if text == "T1 S1":
            assert lines[number + 1].startswith("G92 E")


def test_what_can_t_be_written_is_refused():
    with pytest.raises(ToolpathError, match="has one: take a printer"):
        write_gcode(PATH, ONE, SMALL, PLACE, GcodeOptions())
    with pytest.raises(ToolpathError, match="uses head 2"):
        write_gcode(replace(PATH, tool=PATH.tool * 2), TWO, SMALL, PLACE, OPTIONS)
    with pytest.raises(ToolpathError, match="say it of each"):
        write_gcode(PATH, TWO, SMALL, PLACE, replace(OPTIONS, heads=(HeadLoad(SMALL),)))
    with pytest.raises(ToolpathError, match="ends at 200 mm"):
        write_gcode(PATH, TWO, SMALL, PLACE, replace(OPTIONS, safe_z_mm=201.0))


def test_a_lower_head_lifts_the_carriage_by_as_much_more():
    lower = TWO.heads[1].model_copy(
        update={"offset_mm": TWO.heads[1].offset_mm.model_copy(update={"z": -7.0})}
    )
    printer = TWO.model_copy(update={"heads": (TWO.heads[0], lower)})
    job = Replay(write_gcode(PATH, printer, SMALL, PLACE, OPTIONS).data)
    assert max(after[2] for _, (_, after), *_ in job.rows) == 25.0 + 7.0
    assert {begin[2] for head, begin, *_ in job.strokes if head == 1} == {PLACE[2] + 1.0 + 7.0}
