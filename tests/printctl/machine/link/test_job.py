"""Job files: accepted commands, needle position, path out of the bath."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from design.toolpath.fresh import FreshOptions
from design.toolpath.gcode import GcodeOptions, write_gcode
from firmware_profiles import Printer, Syringe, load
from firmware_profiles.families.position_reply import parse_position
from gcode.dry_run.run import dry_run
from printctl.checks.preflight.firmware import firmware_checks
from printctl.machine.control.board.progress import JobProgress
from printctl.machine.control.board.steps import Exchange
from printctl.machine.control.watch import DueTask, Watch
from printctl.machine.errors import JobError, LinkError, Refused
from printctl.machine.job.care import Care
from printctl.machine.job.coordinates import (
    Modal,
    ModalTrail,
    declared_start,
    disagreement,
    modal_state,
    relieved_mm,
)
from printctl.machine.job.job import Job
from printctl.machine.job.look_places import Written, look_places
from printctl.machine.job.marks import Mark, MarkKind, Marks
from printctl.machine.job.retreat import Retreat, heaters_off
from printctl.machine.process.clients.starting import find_or_start
from printctl.machine.process.orders import Order
from printctl.pipeline.stages import printing
from printctl.recipe.sections.measuring import FileScan, SimulatedScan
from tests.design.toolpath.plans import fresh_toolpath
from tests.design.toolpath.shapes import as_solid, block
from tests.printctl.machine.link.jobs import load_job, parse_job

PRINTER = load(Printer, "generic_marlin")


def test_comments_and_blanks_are_left_out_and_lines_keep_their_place():
    job = parse_job(b"; head\r\n\r\nG90 (absolute)\nM82\n\n  G1 X1 ; there\n", "a")
    assert job.lines == [b"G90", b"M82", b"G1 X1"]
    assert [job.file_line(done) for done in range(5)] == [0, 3, 4, 6, 6]


def test_a_byte_order_mark_is_not_sent():
    text = b"M302 P1\nG90\nG1 X1\n"
    marked = parse_job(b"\xef\xbb\xbf" + text, "a")
    assert (marked.lines, marked.file_lines) == ([b"M302 P1", b"G90", b"G1 X1"], [1, 2, 3])
    assert marked.sha256 == hashlib.sha256(b"\xef\xbb\xbf" + text).hexdigest()


@pytest.mark.parametrize(
    ("line", "why"),
    [
        (b"M83", "relative extrusion"),
        (b"G91", "relative moves"),
        (b"G20", "inches"),
        (b"M0 Click", "button"),
        (b"M110 N4", "renumbers"),
        (b"M112", "halt"),
        (b"M0112", "halt"),
        (b"G1 X1*55", "checksum"),
        (b"G1 X\xb5", "can't be sent"),
        (b"M117 " + b"X1 " * 40, r"exceed 96 \(profile: max_line_bytes\)"),
    ],
)
def test_line_that_must_not_be_sent_is_named(line, why):
    with pytest.raises(JobError, match=f"a, line 2: .*{why}"):
        parse_job(b"G90\n" + line + b"\n", "a")


@pytest.mark.parametrize(
    "line",
    [
        "M500",
        "M502",
        "M92 X100",
        "M206 X1",
        "M211 S0",
        "M220 S120",
        "M221 S90",
        "M301 P1",
        "M118 ok",
    ]
    + ["M113 S0", "M28 a.g", "M84\nM201 X99999", "M204 P99999", "M302 S170\nM999"],
)
def test_what_changes_the_firmware_is_refused_by_its_line(line):
    code = line.splitlines()[-1].split()[0]
    with pytest.raises(JobError, match=f"line {2 + line.count(chr(10))}: {code}"):
        parse_job(f"G90\n{line}\nG1 X1\n".encode(), "a")


def test_empty_and_missing_jobs_are_named(tmp_path):
    with pytest.raises(JobError, match="no command"):
        parse_job(b"; nothing\n", "a")
    with pytest.raises(JobError, match="can't be read"):
        load_job(tmp_path / "none.gcode")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(JobError, match="it is a pipe and no regular file"):
        load_job(tmp_path / "pipe")


@given(st.lists(st.tuples(st.sampled_from("XYZEF"), st.integers(-99, 99)), max_size=30))
def test_modal_state_is_that_of_a_walk_forwards(words):
    lines = [f"G1 {axis}{value}".encode() for axis, value in words]
    walked = {axis.lower(): float(value) for axis, value in words}
    assert modal_state(lines, len(lines)) == Modal(**walked)


def test_position_is_compared_axis_by_axis():
    position = parse_position([b"X:1.00 Y:2.00 Z:0.50 E:0.10 Count X:80 Y:160 Z:200"])
    assert position == {"X": 1.0, "Y": 2.0, "Z": 0.5, "E": 0.1}
    assert disagreement(Modal(x=1.004, e=0.1), position) == ""
    assert "X is 1.00 mm where the job says 1.20" in disagreement(Modal(x=1.2), position)
    assert parse_position([b"ok"]) == {}


def test_retreat_relieves_before_it_lifts_and_stays_below_the_top():
    at = Modal(x=1, y=2, z=195, e=3.0, f=600)
    commands = Retreat(relief_mm=0.5, lift_mm=20).leave(at, PRINTER)
    assert commands == [b"G1 E2.50000 F30", b"G1 Z200.00000 F300"]
    back = Retreat().rejoin(at, PRINTER)
    assert back == [b"G1 Z195.00000 F300", b"G1 E3.00000 F30", b"G1 F600"]
    assert Retreat().leave(Modal(), PRINTER) == []


HEATERS = [b"M104 S0", b"M140 S0"]


@pytest.mark.parametrize(
    ("profile", "changes", "expected"),
    [
        ("generic_marlin", {}, []),  # its cooling stays on
        ("marlin_avr", {}, HEATERS),
        ("marlin_avr", {"safe_state_off": ("M106 P1 S0",)}, [b"M106 P1 S0", *HEATERS]),
        ("two_syringe_marlin", {"safe_state_on": ()}, [b"M104 T0 S0", b"M104 T1 S0", HEATERS[1]]),
    ],
)
def test_what_is_dangerous_and_the_heaters_of_each_head_go_off(profile, changes, expected):
    assert heaters_off(load(Printer, profile).model_copy(update=changes)) == expected


# --- commanded state after some lines of a job: position, relief, settings
WORDS = st.lists(st.sampled_from("XYZEF"), max_size=3, unique=True)
LINES = st.tuples(st.sampled_from(["G1", "G0", "G92", "G28", "M105"]), WORDS, st.integers(0, 9))


@given(st.lists(LINES, max_size=30), st.lists(st.integers(0, 30), max_size=8))
def test_trail_is_the_modal_state_at_every_line_forwards_and_back(lines, asked):
    job = [" ".join([code, *(f"{w}{at}" for w in words)]).encode() for code, words, at in lines]
    trail = ModalTrail(job)
    for done in asked:
        assert trail.at(min(done, len(job))) == modal_state(job, min(done, len(job)))


# --- count of certainly executed lines: a lower bound, exact at standstill
MARLIN = load(Printer, "generic_marlin")
AHEAD = MARLIN.planner_blocks + MARLIN.command_queue
lines = st.lists(st.sampled_from([b"G1 X1", b"G0 Z2", b"M105", b"G4 P10"]), max_size=80)


def progress_of(job: list[bytes], printer: Printer, taken: int = 0) -> JobProgress:
    protocol = SimpleNamespace(lines_done=taken, line_errors=0)
    wiring = SimpleNamespace(printer=printer, protocol=protocol, exchange=Exchange())
    return JobProgress(wiring, Job(job, list(range(1, len(job) + 1)), "", "a"))


@given(lines, st.data())
def test_as_many_moves_as_planner_and_queue_hold_may_be_ahead(job, data):
    progress, last = progress_of(job, MARLIN), 0
    for taken in sorted(data.draw(st.lists(st.integers(0, len(job)), max_size=6))):
        found = progress.executed(taken)
        ahead = sum(line[:1] == b"G" and line[:2] != b"G4" for line in job[found:taken])
        assert last <= found <= taken
        assert found == 0 or ahead == AHEAD
        last = found


@pytest.mark.parametrize("taken", [1, 40])
def test_of_a_planner_by_time_only_a_standstill_counts(taken):
    klipper = MARLIN.model_copy(update={"firmware": "klipper"})
    progress = progress_of([b"G1 X1"] * 50, klipper, taken)
    assert progress.executed(taken) == 0
    progress.stands_still()
    assert progress.executed(taken) == taken


# --- interruption marks in a job (ours and slicers'), and holds at them
def test_marks_stand_between_command_lines():
    text = b"G90\n;LAYER_END:0\n;RELOAD\nG1 X1\n\n;PART_END:3\n;PASS_END:12\r\nG1 X2\n"
    job = parse_job(text, "a")
    assert job.marks.all == (
        Mark(1, MarkKind.LAYER, 0),
        Mark(1, MarkKind.RELOAD),
        Mark(2, MarkKind.PART, 3),
        Mark(2, MarkKind.VESSEL, 12),
    )
    assert [str(mark) for mark in job.marks.all] == [
        "end of layer 1",
        "reload point",
        "end of a part of vessel 3",
        "end of vessel 12",
    ]


@pytest.mark.parametrize(
    ("text", "number"),
    [
        (b";LAYER:%d", 4),
        (b";LAYER_CHANGE", -1),
        (b"; CHANGE_LAYER", -1),
        (b"; layer %d, Z = 0.600", 3),
    ],
)
def test_slicers_layers_end_where_the_next_one_begins(text, number):
    begins = [text.replace(b"%d", b"%d" % k) for k in (4, 5)]
    job = parse_job(b"G90\n" + begins[0] + b"\nG1 X1\n" + begins[1] + b"\nG1 X2\n", "a")
    assert job.marks.all == (Mark(2, MarkKind.LAYER, number),)


marks = st.lists(st.builds(Mark, st.integers(0, 40), st.sampled_from(MarkKind)), max_size=15).map(
    lambda found: sorted(found, key=lambda mark: mark.index)
)


@given(marks, st.integers(0, 41), st.sampled_from(MarkKind))
def test_search_agrees_with_a_walk(found, index, kind):
    of = [mark for mark in found if mark.kind is kind]
    searched = Marks(found)
    assert searched.next(kind, index) == next((m for m in of if m.index >= index), None)
    before = [m.index for m in of if m.index <= index]
    last = searched.last(kind, index)
    assert (last.index if last else None) == (before[-1] if before else None)
    assert {m.kind for m in searched.here(index)} == {m.kind for m in found if m.index == index}


@given(marks, st.integers(0, 40), st.sampled_from(MarkKind), st.booleans())
def test_no_mark_that_is_wanted_is_passed(found, done, kind, idle):
    watch = Watch(Marks(found), Care(checkpoint_s=None))
    watch.begin(0.0)
    watch.after = kind
    ahead = [m.index for m in found if m.kind is kind and m.index > done + (not idle)]
    stop = watch.next_stop(1.0, done, idle, 99)
    assert stop == min([*ahead, 99])
    expected = DueTask.RELOAD if kind is MarkKind.RELOAD else DueTask.PAUSE
    assert (watch.due(1.0, stop) is expected) == (stop != 99)


def told(*lines: str) -> tuple[float, float, float] | None:
    return declared_start(parse_job("\n".join(lines).encode() + b"\n", "job.gcode"))


@pytest.mark.parametrize(
    "lines", [["G92 X100 Y90", "G1 X101 F600"], ["G1 X101 F600", "G92 X0 Y0 Z0", "G1 X1"]]
)
def test_a_place_that_is_told_in_part_or_late_is_refused(lines):
    with pytest.raises(LinkError, match=r"G92 X.* sets the tip position"):
        told(*lines)


# --- places at which looks are due: by way, time of writing and height; ends of lines in layers
def spaced(layers=2, lines=3, mark="LAYER_END", relieves=True, wipes=False):
    """Lines of 10 mm at 10 mm/s in layers of 0.25 mm, each left by a travel."""
    text, e = ["G90", "M82", "G92 X0 Y0 Z5 E0"], 0.0
    for layer in range(layers):
        z = 1 + 0.25 * layer
        for k in range(lines):
            x = k % 2 * 10
            text += [f"G0 X{x} Y{k} F6000", f"G1 Z{z:g} F300"]
            text += [f"G1 E{e:.4f} F60"] * relieves
            e += 0.1
            text.append(f"G1 X{10 - x} E{e:.4f} F600")
            text += [f"G0 X{10 - x} Y{k + 0.2} F6000"] * wipes
            text += [f"G1 E{e - 0.05:.4f} F60"] * relieves
            text.append(f"G0 Z{z + 0.5:g} F300")
        text.append(f";{mark}:{layer}")
    return parse_job(("\n".join(text) + "\nG0 X50 F600\n").encode(), "a")


def places(job, within=True):
    return look_places(job.lines, job.marks, job.positions, within=within)


@pytest.mark.parametrize(
    ("care", "mm"),
    [
        (Care(look_every_mm=15.0), [20, 40, 60]),
        (Care(look_every_written_s=1.5), [20, 40, 60]),
        (Care(look_every_height_mm=0.5), [60 + 30, 60 + 90]),
        (Care(look_every_height_mm=0.25), [60, 90, 120, 150]),
        (Care(look_every_height_mm=9.0), []),
    ],
)
def test_a_look_is_due_behind_enough_way_time_or_height(care, mm):
    job = spaced(5 if care.look_every_height_mm else 2)
    found, looked, first, seen = places(job), Written(), 0, []
    while (index := found.next_due(first, looked, care)) is not None:
        looked, first = found.at(index), index + 1
        seen.append(round(looked.way_mm))
    assert seen == mm


# --- aerotech controllers: every command that would send lines refuses, with the reason
PROFILE = "aerotech_pneumatic"
PRINTER_UNSENT = load(Printer, PROFILE)
START = (50.0, 60.0, 30.0)


def job() -> bytes:
    toolpath = fresh_toolpath(as_solid(block(2, 2, 0.18)), FreshOptions())
    options = GcodeOptions(start_mm=START, flow_ul_s=0.12)
    return write_gcode(
        toolpath, PRINTER_UNSENT, load(Syringe, "hamilton_1ml"), (60, 70, 20), options
    ).data


def nothing() -> str:
    raise AssertionError("a port was opened")


@pytest.mark.parametrize("resume", [False, True])
@pytest.mark.parametrize("port", ["simulated", "/dev/ttyACM0"])
def test_a_print_is_refused_before_a_port_is_looked_for(
    tmp_path: Path, port: str, resume: bool
) -> None:
    file = tmp_path / "part.gcode"
    file.write_bytes(job())
    order = Order(file, PROFILE, port, tmp_path / "print", Retreat(), resume=resume)
    with pytest.raises(Refused, match=r"Load .*part\.gcode in the controller's own software"):
        find_or_start(order, nothing)
    assert [path.name for path in tmp_path.iterdir()] == ["part.gcode"]


def test_its_marks_are_read() -> None:
    data = job()
    found = parse_job(data, "part.gcode", PRINTER_UNSENT)
    layers = [mark.number for mark in found.marks.of(MarkKind.LAYER)]
    assert layers == [0, 1, 2]
    assert not any(line.startswith(b"//") for line in found.lines)
    commands = dry_run(data, PRINTER_UNSENT, START).program.command
    assert len(found) == commands[-1] + 1


def test_preflight_tells_what_is_to_be_seen_to_by_hand() -> None:
    checks = firmware_checks(dry_run(job(), PRINTER_UNSENT, START), PRINTER_UNSENT)
    assert [(check.check, check.weight) for check in checks] == [("operator check", "warns")]
    assert "load the file in the controller's own software" in checks[0].remedy


def context(folder: Path, scan: Any, said: list[str]) -> Any:
    return SimpleNamespace(
        printer=PRINTER_UNSENT,
        folder=folder,
        scan_part=scan,
        printed=False,
        recipe=SimpleNamespace(printer=SimpleNamespace(port="auto")),
        bars=SimpleNamespace(remark=lambda stage, text: said.append(f"{stage}: {text}")),
    )


def test_a_runs_print_is_left_out_with_a_word_where_the_scan_is_a_file(tmp_path: Path) -> None:
    said: list[str] = []
    scan = FileScan(file="scan.tif")
    summary, files = printing.work(context(tmp_path, scan, said), lambda *_: None)
    assert summary["state"] == "by hand"
    assert not files
    assert len(said) == 1
    assert said[0].startswith("print: left out: Aerotech gantry")
    assert list(tmp_path.iterdir()) == []


def test_a_run_ends_there_where_the_scan_would_be_simulated(tmp_path: Path) -> None:
    scan = SimulatedScan(simulated="oct")
    with pytest.raises(Refused, match="give the scan of the part as a file"):
        printing.work(context(tmp_path, scan, []), lambda *_: None)


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ([], 0.0),
        ([b"G1 E1", b"G1 E0.75 F60", b"G0 Z5"], 0.25),
        ([b"G1 E1", b"G1 X1 E1.5"], 0.0),
        ([b"G1 E1", b"G1 E0.75", b"G1 E1"], 0.0),
        ([b"G1 E5", b"G92 E0", b"G0 X1"], 0.0),
        ([b"G1 E5", b"G92 E0", b"G1 E-0.25"], 0.25),
        ([b"G1 E1", b"G1 E0.75", b"G0 X1 Y1", b"M105", b"G1 F600"], 0.25),
        ([b"G1 E1"], 0.0),
    ],
)
def test_relief_of_the_job_itself_is_found(lines, expected):
    assert relieved_mm(lines, len(lines)) == pytest.approx(expected)
