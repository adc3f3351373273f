"""Recovery of a job after a power cut: from a chosen checkpoint, approached from above."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_profiles import Printer, load
from gcode.dry_run.run import dry_run
from gcode.motion.executed import ExecutedMotion
from printctl.checks.preflight import gcode_checks
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.errors import LinkError
from printctl.machine.job.care import Care
from printctl.machine.job.coordinates import Modal
from printctl.machine.job.marks import MarkKind
from printctl.machine.job.moves import moves_ahead, surely_moved
from printctl.machine.job.retreat import Retreat
from printctl.machine.job.stop_place import StopPlace, find_stop_line
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.prints.recovery import NoCheckpoint, Recovery, plan_recovery
from printctl.machine.records.replay import JournalledPrint, read_journal
from printctl.machine.records.states import LinkState, Status
from sim.devices.families.marlin_printer import MarlinPrinter
from sim.devices.faults import parse_fault
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import Script, layered, played
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import PRINTER, START, foreseen, gcode, printed, wire
from tests.printctl.machine.link.test_halting import MARLIN as MARLIN
from tests.printctl.machine.link.test_halting import RETREAT as RETREAT_STOP_PLACE
from tests.printctl.machine.link.test_halting import START_HEADER as HEADER
from tests.printctl.machine.link.test_halting import Moment
from tests.printctl.machine.link.test_halting import stopped_at as stopped

DATA = layered(5, 20)
JOB = parse_job(DATA, "test.gcode")
FORESEEN = foreseen(DATA)
RETREAT = Retreat(relief_mm=0.3)
NOTHING_KNOWN = JournalledPrint()


def rows(motion: ExecutedMotion, keep: np.ndarray) -> np.ndarray:
    pushed = motion.plunger_end - motion.plunger_start
    return np.column_stack([motion.start, motion.end, pushed])[keep]


def assert_rest_is_the_jobs(plan: Recovery) -> ExecutedMotion:
    """Run the file on a fresh printer: its way in is free, all that follows is as in the job."""
    run = dry_run(plan.gcode, PRINTER, START, cold_extrusion=False)
    assert run.unknown == ()
    commands = parse_job(plan.gcode, "rest")
    before = len(commands) - (len(JOB) - plan.begin)
    assert commands.lines[before:] == JOB.lines[plan.begin :]
    motion = run.executed
    ours = rows(motion, motion.line >= before)
    foreseen = rows(FORESEEN, FORESEEN.line >= plan.begin)
    assert ours.shape == foreseen.shape
    np.testing.assert_array_equal(ours[:, :6], foreseen[:, :6])
    np.testing.assert_allclose(ours[:, 6], foreseen[:, 6], atol=1e-9)
    assert_free_way(motion, motion.line < before)
    return motion


def assert_free_way(motion: ExecutedMotion, keep: np.ndarray) -> None:
    """Up, across above everything, straight down, then prime: never two of them at once."""
    across = np.any(motion.start[keep, :2] != motion.end[keep, :2], axis=1)
    top = FORESEEN.end[:, 2].max()
    heights = np.minimum(motion.start[keep, 2], motion.end[keep, 2])
    assert (heights[across] >= top).all()
    pushes = motion.plunger_end[keep] - motion.plunger_start[keep]
    still = np.all(motion.start[keep] == motion.end[keep], axis=1)
    assert (pushes[~still] == 0).all()


@pytest.mark.parametrize("line", [70, 95, 118])
def test_rest_after_a_power_cut_is_moved_as_the_job_foresaw(tmp_path, line):
    printer = MarlinPrinter(PRINTER, START, faults=(parse_fault(f"reset@{line}"),))
    transport = SimTransport(printer, VirtualClock())
    status = played(DATA, tmp_path, transport, Script(), Care(checkpoint_s=0.0), retreat=RETREAT)
    assert status.state is LinkState.POSITION_UNKNOWN
    history = read_journal(tmp_path / "journal.log")
    plan = plan_recovery(JOB, DATA, history, PRINTER, RETREAT)
    marks = [mark.index for mark in JOB.marks.of(MarkKind.LAYER)]
    assert plan.begin in marks
    assert plan.start == START
    # What the journal calls sure had really been moved when the power went.
    moved = transport.printer.executed().line
    assert plan.begin <= surely_moved(JOB.lines, history.done, 20)
    assert len(moved) >= np.count_nonzero(FORESEEN.line < plan.begin)
    assert_rest_is_the_jobs(plan)
    assert "would be written twice" in " ".join(plan.steps)


def assert_checks_take_the_place(plan):
    """`printctl print` doesn't refuse the rest for a place that it tells twice."""
    run = dry_run(plan.gcode, PRINTER, START, cold_extrusion=False)
    assert not [row for row in gcode_checks(run, PRINTER) if row.check.startswith("place of")]


@pytest.mark.parametrize("begin", range(7, len(JOB) - 1, 9))
def test_rest_from_any_line_is_moved_as_the_job_foresaw(begin):
    plan = plan_recovery(
        JOB, DATA, JournalledPrint(done=len(JOB)), PRINTER, RETREAT, from_line=JOB.file_lines[begin]
    )
    assert plan.begin == begin
    assert_rest_is_the_jobs(plan)


def test_plunger_counted_anew_in_the_job_is_taken_over():
    lines = DATA.decode().split("\n")
    at = next(k for k, text in enumerate(lines) if text.startswith(";LAYER_END:1"))
    e = float(next(text for text in lines[at::-1] if " E" in text).split("E")[1].split()[0])
    moved = [
        text if k <= at or " E" not in text else shifted(text, e) for k, text in enumerate(lines)
    ]
    moved.insert(at + 1, "G92 E0")
    data = "\n".join(moved).encode()
    job = parse_job(data, "a")
    begin = job.marks.of(MarkKind.LAYER)[2].index
    plan = plan_recovery(
        job, data, JournalledPrint(done=0), PRINTER, RETREAT, from_line=job.file_lines[begin]
    )
    rest = parse_job(plan.gcode, "rest")
    before = len(rest) - (len(job) - begin)
    motion = dry_run(plan.gcode, PRINTER, START).executed
    whole = dry_run(data, PRINTER, START).executed
    ours, foreseen = rows(motion, motion.line >= before), rows(whole, whole.line >= begin)
    np.testing.assert_array_equal(ours[:, :6], foreseen[:, :6])
    np.testing.assert_allclose(ours[:, 6], foreseen[:, 6], atol=1e-9)


def shifted(text: str, by: float) -> str:
    before, _, after = text.partition("E")
    value, _, rest = after.partition(" ")
    return f"{before}E{float(value) - by:.5f} {rest}"


def test_settings_are_carried_over_as_they_stood():
    data = DATA.replace(b";LAYER_END:1\n", b"M104 S37\nM140 S4\nM104 S20\n;LAYER_END:1\n")
    job = parse_job(data, "a")
    begin = job.marks.of(MarkKind.LAYER)[2].index
    plan = plan_recovery(
        job, data, NOTHING_KNOWN, PRINTER, RETREAT, from_line=job.file_lines[begin]
    )
    lines = parse_job(plan.gcode, "a").lines
    assert {b"G21", b"G90", b"M82", b"M85 S600", b"M302 P1", b"M140 S4"} <= set(lines[:10])
    assert b"M104 S20" in lines[:10]
    assert b"M104 S37" not in lines


def test_checkpoint_whose_moves_may_still_have_been_queued_is_not_believed():
    marks = [mark.index for mark in JOB.marks.of(MarkKind.LAYER)]
    made = [{"done": index, "mark": f"end of layer {k}"} for k, index in enumerate(marks)]
    just_after = JournalledPrint(done=marks[2] + 5, checkpoints=made[:3])
    assert plan_recovery(JOB, DATA, just_after, PRINTER, RETREAT).begin == marks[1]
    long_after = JournalledPrint(done=marks[3] - 1, checkpoints=made[:3])
    assert plan_recovery(JOB, DATA, long_after, PRINTER, RETREAT).begin == marks[2]
    with pytest.raises(LinkError, match="no checkpoint before line"):
        plan_recovery(JOB, DATA, JournalledPrint(done=30, checkpoints=made[:1]), PRINTER, RETREAT)


def renamed(at: int, by: dict[str, float]) -> bytes:
    """The job with a G92 after a layer's end that calls X, Y and Z so much more from there on."""
    lines, place, seen = DATA.decode().split("\n"), dict[str, float](), False
    for k, text in enumerate(lines):
        words = {word[0]: word for word in text.split(" ") if word[:1] in "XYZ" and word}
        if seen and text.startswith(("G0 ", "G1 ")):
            for axis, word in words.items():
                shifted_word = f"{axis}{float(word[1:]) + by.get(axis, 0.0):.5f}"
                text = text.replace(word, shifted_word)
            lines[k] = text
        elif not seen:
            place |= {axis: float(word[1:]) for axis, word in words.items()}
        if text.startswith(f";LAYER_END:{at}"):
            told = " ".join(f"{axis}{place[axis] + mm:.5f}" for axis, mm in by.items())
            lines[k] += f"\nG92 {told}"
            seen = True
    return "\n".join(lines).encode()


@pytest.mark.parametrize("begin", range(7, len(JOB) - 1, 9))
@pytest.mark.parametrize(
    "by", [{"Z": 0.0}, {"X": 0.0, "Y": 0.0, "Z": 0.0}, {"X": -12.5, "Z": 3.25}, {"Y": 7.0}]
)
def test_a_rest_is_placed_where_a_line_of_the_job_has_renamed_its_place(begin, by):
    """By nothing (the place that the needle has anyway), or by what the job's text tells."""
    data = renamed(1, by)
    job = parse_job(data, "a")
    line = job.file_lines[begin]
    plan = plan_recovery(
        job, data, JournalledPrint(done=len(job)), PRINTER, RETREAT, from_line=line
    )
    rest = parse_job(plan.gcode, "rest")
    before = len(rest) - (len(job) - plan.begin)
    motion = dry_run(plan.gcode, PRINTER, START, cold_extrusion=False).executed
    whole = dry_run(data, PRINTER, START, cold_extrusion=True).executed
    ours, foreseen = rows(motion, motion.line >= before), rows(whole, whole.line >= plan.begin)
    np.testing.assert_allclose(ours, foreseen, atol=1e-4)
    as_it_was = rows(FORESEEN, FORESEEN.line >= 0)
    np.testing.assert_allclose(rows(whole, whole.line >= 0), as_it_was, atol=1e-4)
    assert_free_way(motion, motion.line < before)
    assert plan.start == START


def test_a_place_that_is_told_behind_the_first_move_keeps_the_rest_from_being_placed():
    data = DATA.replace(b"G92 X50 Y50 Z10 E0", b"G92 E0")
    data = data.replace(b";LAYER_END:0\n", b"G92 X0\n;LAYER_END:0\n")
    job = parse_job(data, "a")
    line = job.file_lines[job.marks.of(MarkKind.LAYER)[1].index]
    with pytest.raises(LinkError, match=r"line \d+ \(G92 X0\) redefines a position"):
        plan_recovery(job, data, NOTHING_KNOWN, PRINTER, RETREAT, from_line=line)


@pytest.mark.parametrize(
    ("told", "late"),
    [
        ("G92 Z10 E0", ""),
        ("G92 X50 Y50 E0", ""),
        ("G92 X30 E0", ""),
        ("G92 E0", "G92 X12.5\n"),
        ("G92 Z7 E0", ""),
    ],
)
def test_a_job_that_tells_a_part_of_its_place_is_gone_on_with_from_where_it_was_checked(told, late):
    data = DATA.replace(b"G92 X50 Y50 Z10 E0", told.encode())
    data = data.replace(b";LAYER_END:0\n", b";LAYER_END:0\n" + late.encode())
    job = parse_job(data, "test.gcode")
    line = job.file_lines[job.marks.of(MarkKind.LAYER)[2].index]
    plan = plan_recovery(job, data, NOTHING_KNOWN, PRINTER, RETREAT, from_line=line, start_mm=START)
    assert plan.start == START
    whole = dry_run(data, PRINTER, START, cold_extrusion=True).executed
    rest = dry_run(plan.gcode, PRINTER, START, cold_extrusion=False).executed
    before = len(parse_job(plan.gcode, "rest")) - (len(job) - plan.begin)
    ours, foreseen = rows(rest, rest.line >= before), rows(whole, whole.line >= plan.begin)
    np.testing.assert_allclose(ours, foreseen, atol=1e-4)
    assert_checks_take_the_place(plan)
    with pytest.raises(LinkError, match="after a loss of position"):
        plan_recovery(job, data, NOTHING_KNOWN, PRINTER, RETREAT, from_line=line)


ARCS = b"""M302 P1
G90
M82
M85 S600
G92 X30 Z0 E0
G1 X31 E0.1 F600 ; one
G2 X33 Y50 I1 J0 E0.2;two
G92 X33 E0
G92 X0
;LAYER_END:0
G3 X3 Y50 R2 E0.1
G1 X5 Z1 E0.2
G1 Y60 Z1 E0.2
M400
"""


def test_arcs_comments_and_later_places_of_a_rest_are_counted_from_the_touch_off():
    job = parse_job(ARCS, "test.gcode")
    plan = plan_recovery(job, ARCS, NOTHING_KNOWN, PRINTER, RETREAT, from_line=6, start_mm=START)
    rest = plan.gcode.splitlines()
    assert rest[rest.index(b"G1 X51 E0.1 F600; one") + 1 :] == [
        b"G2 X53 Y50 I1 J0 E0.2;two",
        b"G92 X53 E0",
        b"G92 X53",
        b";LAYER_END:0",
        b"G3 X56 Y50 R2 E0.1",
        b"G1 X58 Z11 E0.2",
        b"G1 Y60 Z11 E0.2",
        b"M400",
    ]
    told = [line for line in rest if line.startswith(b"G92 X50")]
    assert told == [b"G92 X50.00000 Y50.00000 Z10.00000"]


def test_a_rest_in_the_middle_of_a_line_is_counted_from_the_touch_off():
    stood = {"line": 10, "certain": True, "dropped": True}
    stood["begin_at"] = {"x": 4.0, "y": 50.0, "z": 0.5, "e": 0.15, "f": 600.0}
    job = parse_job(ARCS, "test.gcode")
    plan = plan_recovery(job, ARCS, JournalledPrint(stood=stood), PRINTER, RETREAT, start_mm=START)
    run = dry_run(plan.gcode, PRINTER, START, cold_extrusion=False).executed
    np.testing.assert_allclose(run.start[-2], [57, 50, 10.5])
    np.testing.assert_allclose(run.end[-2:], [[58, 50, 11], [58, 60, 11]])


def test_klipper_is_told_the_place_in_its_own_words():
    lines = ["G21", "G90", "M82", "SET_KINEMATIC_POSITION X=30", "G92 E0"]
    lines += [f"G1 X{30 + k} Y100 Z20 E{0.1 * k:.1f} F600" for k in range(1, 9)]
    data = "\n".join([*lines, "SET_KINEMATIC_POSITION X=38", "M400", ""]).encode()
    klipper = load(Printer, "klipper_bioprinter")
    job, start = parse_job(data, "a", klipper), (100.0, 100.0, 20.0)
    plan = plan_recovery(job, data, NOTHING_KNOWN, klipper, RETREAT, from_line=9, start_mm=start)
    assert b"SET_KINEMATIC_POSITION X=100.00000 Y=100.00000 Z=20.00000\n" in plan.gcode
    assert plan.gcode.endswith(b"G1 X108 Y100 Z20 E0.8 F600\nSET_KINEMATIC_POSITION X=108\nM400\n")
    again = [one.check for one in gcode_checks(dry_run(plan.gcode, klipper, start), klipper)]
    assert not any("redefined" in check for check in again)


def test_a_rest_is_planned_where_klipper_alone_was_told_the_height():
    lines = ["G21", "G90", "M82", "SET_KINEMATIC_POSITION X=100 Y=100 Z=20", "G92 E0"]
    lines += [f"G1 X{100 + k} Y100 E{0.1 * k:.1f} F600" for k in range(1, 9)]
    data = "\n".join([*lines, "M400", ""]).encode()
    klipper = load(Printer, "klipper_bioprinter")
    job = parse_job(data, "a", klipper)
    for line in (7, 10):
        plan = plan_recovery(job, data, NOTHING_KNOWN, klipper, RETREAT, from_line=line)
        assert plan.start == (100, 100, 20)
        assert b"Z20" in plan.gcode


def test_the_rest_says_its_first_layer_s_height(tmp_path):
    """Layers of different heights: a reader of the rest alone can't know it from the tip's."""
    lines = DATA.splitlines(keepends=True)
    said = b"".join((b";HEIGHT:%.3f\n" % (0.06 + 0.001 * k)) + line for k, line in enumerate(lines))
    printer = MarlinPrinter(PRINTER, START, faults=(parse_fault("reset@95"),))
    transport = SimTransport(printer, VirtualClock())
    played(DATA, tmp_path, transport, Script(), Care(checkpoint_s=0.0), retreat=RETREAT)
    job, history = parse_job(said, "test.gcode"), read_journal(tmp_path / "journal.log")
    plan = plan_recovery(job, said, history, PRINTER, RETREAT)
    rest = plan.gcode.splitlines()
    first = next(k for k, line in enumerate(rest) if line.startswith(b";HEIGHT:"))
    before = said.splitlines()[: job.file_lines[plan.begin] - 1]
    assert rest[first] == [line for line in before if line.startswith(b";HEIGHT:")][-1]
    assert_rest_is_the_jobs(plan)


# --- recovery without a checkpoint, from a held print's, and from one whose motors stood
def test_without_a_checkpoint_the_first_line_that_may_not_be_made_is_named():
    """Command 60 was taken, 20 moves may be ahead: begin with the line of command 41."""
    with pytest.raises(NoCheckpoint) as refused:
        plan_recovery(JOB, DATA, JournalledPrint(done=60), PRINTER, RETREAT)
    made = surely_moved(JOB.lines, 60, moves_ahead(PRINTER))
    assert refused.value.line == JOB.file_lines[made] > 0
    assert f"line {refused.value.line} is the first" in str(refused.value)
    assert plan_recovery(JOB, DATA, JournalledPrint(done=60), PRINTER, RETREAT, refused.value.line)


def test_where_no_move_was_surely_made_it_is_told_what_to_look_up():
    klipper = PRINTER.model_copy(update={"firmware": "klipper"})
    for printer, done in ((PRINTER, 12), (klipper, 60)):
        with pytest.raises(NoCheckpoint, match="the first line that isn't on the part") as refused:
            plan_recovery(JOB, DATA, JournalledPrint(done=done), printer, RETREAT)
        assert refused.value.line == 0


def test_rest_after_a_power_cut_in_a_pause_begins_where_it_was_held(tmp_path):
    """A job without marks; the motors stood, so that nobody has to say with which line."""
    data = gcode(80)
    transport = wire()
    asked: list[LinkState] = []

    def on_status(status: Status) -> None:
        if status.lines_done > 40 and not asked:
            asked.append(status.state)
            streamers[0].pause()
        if status.state is LinkState.PAUSED and len(asked) == 1:
            asked.append(status.state)
            transport.printer.reset()

    streamers: list[Streamer] = []
    status, _ = printed(data, tmp_path, transport, on_status=on_status, keep=streamers)
    assert status.state is LinkState.POSITION_UNKNOWN
    plan = plan_recovery(
        parse_job(data, "test.gcode"),
        data,
        read_journal(tmp_path / "journal.log"),
        PRINTER,
        RETREAT,
    )
    assert plan.begin == status.lines_done == status.lines_executed > 40


def checkpoint(done: int, **more: bool) -> dict[str, object]:
    return {"t": "checkpoint", "done": done, "mark": "end of layer 1", "agrees": True, **more}


def test_checkpoint_of_a_firmware_that_plans_by_time_counts_where_its_motors_stood():
    """Hundreds of short moves may be ahead: 308 lines were left out on a real Klipper."""
    klipper = load(Printer, "klipper_bioprinter")
    history = JournalledPrint(done=100, checkpoints=[checkpoint(60)])
    with pytest.raises(NoCheckpoint):
        plan_recovery(JOB, DATA, history, klipper, RETREAT)
    stood = JournalledPrint(done=100, made=60, checkpoints=[checkpoint(60, stands=True)])
    assert plan_recovery(JOB, DATA, stood, klipper, RETREAT).begin == 60


# --- stop position of a printer in its job, and the rest by `recover`
LINES = [b"G1 X10 Y0 Z1 E1", b"G1 X10 Y10 E2", b"G1 X0 Y10 E3", b"G1 X0 Y0 E4", b"G1 X10 Y0 E5"]
PLACED = [b"G92 X0 Y0 Z1 E0", *LINES]
JOB_STOP_PLACE = HEADER + "".join(
    f"G1 X{50 + 20 * (k % 2)} Y{50 + k / 4:.2f} E{k / 10:.1f} F1200\n" for k in range(1, 61)
)


def test_a_place_that_is_passed_twice_is_told_by_the_plunger():
    found = find_stop_line(PLACED, 1, 6, Modal(5.0, 0.0, 1.0, 4.5))
    assert (found.line, found.certain) == (5, True)


@pytest.mark.parametrize("place", [Modal(5.0, 5.0, 1.0, 2.5), Modal(10.0, 4.0, 1.0, 3.0)])
def test_a_place_beside_all_lines_offers_the_first_that_may_be_open(place):
    assert find_stop_line(PLACED, 1, 6, place) == StopPlace(1, None, False)


def written(motion: ExecutedMotion) -> tuple[np.ndarray, float]:
    """Length and plunger travel of what is written sideways, all in all."""
    sideways = np.any(motion.start[:, :2] != motion.end[:, :2], axis=1)
    pushed = (motion.plunger_end - motion.plunger_start)[sideways]
    length = np.linalg.norm(motion.end - motion.start, axis=1)[sideways]
    return length[pushed > 0].sum(), pushed[pushed > 0].sum()


@pytest.mark.parametrize("after_s", [0.3, 0.9, 4.7, 5.62])  # not within 0.5 mm of a corner
@pytest.mark.parametrize("count", [8, 20])
def test_what_was_made_and_the_rest_are_the_job(tmp_path, after_s, count):
    status, wire = stopped(Moment(b"G1 X", after_s, count), tmp_path, job=JOB_STOP_PLACE)
    history = read_journal(tmp_path / "journal.log")
    assert history.stood is not None
    assert history.stood["certain"], history.stood
    job = parse_job(JOB_STOP_PLACE.encode(), "test.gcode")
    plan = plan_recovery(job, JOB_STOP_PLACE.encode(), history, MARLIN, RETREAT_STOP_PLACE)
    first = wire.printer.executed()
    rest = dry_run(plan.gcode, MARLIN, (50.0, 50.0, 10.0), cold_extrusion=True).executed
    whole = written(dry_run(JOB_STOP_PLACE.encode(), MARLIN, (50.0, 50.0, 10.0)).executed)
    made = np.add(written(first), written(rest))
    assert made[0] == pytest.approx(whole[0], abs=0.05)
    assert made[1] == pytest.approx(whole[1], abs=0.003)
    told = " ".join(plan.steps)
    assert "nothing is left out or written twice" in told, status


def test_a_stop_in_a_pause_goes_on_with_the_next_line(tmp_path):
    stopped(Moment(b"G1 Z", 0.2, count=3), tmp_path, job=JOB_STOP_PLACE)
    history = read_journal(tmp_path / "journal.log")
    assert history.stood is not None
    assert (history.stood["line"], history.stood["certain"]) == (history.done, True)


def test_nothing_is_left_of_a_job_whose_lines_were_all_made():
    job = parse_job(JOB_STOP_PLACE.encode(), "a")
    stood = {"line": len(job), "begin_at": None, "certain": True, "dropped": False}
    history = JournalledPrint(done=len(job), stood=stood)
    with pytest.raises(LinkError, match="every line"):
        plan_recovery(job, JOB_STOP_PLACE.encode(), history, MARLIN, RETREAT_STOP_PLACE)


@pytest.mark.parametrize("after_s", [0.3, 4.7])
def test_lines_that_were_certainly_made_before_a_stop_are_told_as_made(tmp_path, after_s):
    """`stood` counts them; the planner may have held each of them when it was told to drop all."""
    status, _ = stopped(Moment(b"G1 X", after_s, 20), tmp_path, job=JOB_STOP_PLACE)
    stood = read_journal(tmp_path / "journal.log").stood
    assert stood is not None
    assert stood["certain"]
    assert status.lines_executed == stood["line"] > len(HEADER.splitlines())


def test_an_uncertain_place_adds_no_line_to_those_made(tmp_path):
    job = HEADER + "".join(
        f"G3 X{50 + 20 * (k % 2)} Y50 I{10 - 20 * (k % 2)} J0 E{k / 10:.1f} F2400\n"
        for k in range(1, 21)
    )
    status, _ = stopped(Moment(b"G3 X", 0.9, 8), tmp_path, job=job)
    stood = read_journal(tmp_path / "journal.log").stood
    assert stood is not None
    assert not stood["certain"]
    assert status.lines_executed <= stood["line"]


EACH = HEADER + "".join(
    f"G92 E0\nG1 X{50 + 20 * (k % 2)} Y{50 + k / 4:.2f} E0.1 F1200\n" for k in range(1, 61)
)


@pytest.mark.parametrize("after_s", [0.3, 0.9, 4.7])
def test_a_rest_begins_where_it_stood_though_each_line_counts_anew(tmp_path, after_s):
    _, wire = stopped(Moment(b"G1 X", after_s, 20), tmp_path, job=EACH)
    history = read_journal(tmp_path / "journal.log")
    assert history.stood is not None
    assert history.stood["certain"], history.stood
    job = parse_job(EACH.encode(), "test.gcode")
    plan = plan_recovery(job, EACH.encode(), history, MARLIN, RETREAT_STOP_PLACE)
    rest = dry_run(plan.gcode, MARLIN, (50.0, 50.0, 10.0), cold_extrusion=True).executed
    whole = written(dry_run(EACH.encode(), MARLIN, (50.0, 50.0, 10.0)).executed)
    made = np.add(written(wire.printer.executed()), written(rest))
    assert made[0] == pytest.approx(whole[0], abs=0.05)
    assert made[1] == pytest.approx(whole[1], abs=0.003)


def test_an_uncertain_beginning_says_how_much_is_written_twice():
    job = HEADER + "G1 X60 E0.5 F600\nG3 X60 Y60 I0 J5 E1\nG1 Z20\nG1 X50 E1.5\n"
    stood = {"line": 6, "begin_at": None, "certain": False, "dropped": True}
    history = JournalledPrint(done=9, stood=stood)
    read = parse_job(job.encode(), "a")
    plan = plan_recovery(read, job.encode(), history, MARLIN, RETREAT_STOP_PLACE, ul_per_mm=10.0)
    told = "at most 25.7 mm of path and 10.00 µL (1.000 mm of plunger), lines 7 to 9."
    assert f"Written twice may be {told}" in plan.steps[-1]


@pytest.mark.parametrize("line", [1, 10_000])
def test_line_outside_the_job_is_refused(line):
    with pytest.raises(LinkError, match="isn't between"):
        plan_recovery(JOB, DATA, NOTHING_KNOWN, PRINTER, RETREAT, from_line=line)
