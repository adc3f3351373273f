"""Jobs that have grown by inserts: rest after a power cut, true state, counts of the file."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from printctl.cli.machine.running_print import waiting_lines
from printctl.machine.control.board.progress import JobProgress
from printctl.machine.control.board.steps import Exchange, Steps
from printctl.machine.control.position.frame_check import FrameCheck
from printctl.machine.errors import Refused
from printctl.machine.job.coordinates import Modal, frame_at
from printctl.machine.job.insert_check import (
    InsertPlace,
    JobReach,
    check_factor,
    check_flow,
    judged_lines,
)
from printctl.machine.job.job import Insert
from printctl.machine.job.marks import MarkKind
from printctl.machine.job.retreat import Retreat
from printctl.machine.job.syringes import Filling, plunger_travel
from printctl.machine.prints.mends import pushed_mm
from printctl.machine.prints.progress import JobTable, Supply, ink_left_ul
from printctl.machine.prints.recovery import plan_recovery
from printctl.machine.prints.state import possible_actions
from printctl.machine.process.outcome import read_outcome
from printctl.machine.records.journal import Journal
from printctl.machine.records.record import JOURNAL, ContactRecord
from printctl.machine.records.replay import JournalledPrint
from printctl.machine.records.states import LinkState, Status
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import layered
from tests.printctl.machine.link.looking import patch
from tests.printctl.machine.link.simulated import PRINTER
from tests.printctl.machine.link.stepping import ended

DATA = layered(3, 6)
OWN = parse_job(DATA, "test.gcode")
ENDS = [mark.index for mark in OWN.marks.of(MarkKind.LAYER)]


def mend(layer: int, look: int, before: int) -> Insert:
    lines = parse_job("\n".join(patch(DATA, layer)).encode(), "a").lines
    return Insert(look, ENDS[layer] + before, tuple(lines), "a gap")


FIRST, SECOND = mend(0, 1, 0), mend(1, 2, 11)
GROWN = OWN.grown(FIRST).grown(SECOND)


@pytest.mark.parametrize("begin", range(8, len(GROWN) - 1))
def test_rest_from_any_line_of_a_grown_job_is_the_grown_jobs(begin):
    stood = {"line": begin, "begin_at": None, "certain": True, "dropped": False, "done": begin}
    plan = plan_recovery(GROWN, DATA, JournalledPrint(stood=stood), PRINTER, Retreat())
    rest = parse_job(plan.gcode, "rest").lines
    assert rest[len(rest) - (len(GROWN) - begin) :] == GROWN.lines[begin:]


@pytest.mark.parametrize("begin", range(12, len(GROWN) - 13, 4))
def test_rest_of_a_job_whose_flow_was_corrected_has_its_doses(begin):
    data = DATA.replace(b"F1800\n", b"F1800 ; here\n")
    job = parse_job(data, "test.gcode")
    grown = job.grown(replace(FIRST, flow=1.3)).grown(Insert(2, SECOND.after, (), "", 0.9))
    stood = {"line": begin, "begin_at": None, "certain": True, "dropped": False, "done": begin}
    plan = plan_recovery(grown, data, JournalledPrint(stood=stood), PRINTER, Retreat())
    rest = parse_job(plan.gcode, "rest").lines
    assert rest[len(rest) - (len(grown) - begin) :] == grown.lines[begin:]
    travel = plunger_travel(grown.lines)
    own = plunger_travel(job.lines)
    third = ENDS[1] + 11, ENDS[2] + 11
    writes = [k for k in range(*third) if b" X" in grown.lines[k] and b" E" in grown.lines[k]]
    ratios = [(travel[k + 1] - travel[k]) / (own[k - 10] - own[k - 11]) for k in writes]
    assert ratios == pytest.approx([0.9] * len(writes), abs=5e-3)


def test_an_interrupted_print_counts_what_was_put_in(tmp_path):
    file = tmp_path / "a.gcode"
    file.write_bytes(DATA)
    ContactRecord(0, "", "", str(file), "generic_marlin", "", 0.0).save(tmp_path)
    journal = Journal(tmp_path / JOURNAL)
    journal.add("job", sha256=OWN.sha256, lines=len(OWN))
    journal.add("state", state=LinkState.PRINTING, message="printing")
    journal.add("insert", **FIRST.to_record(), reload_at=[], reload_heads=[])
    done = FIRST.after + 13
    journal.add("ack", done=done)
    journal.add("state", state=LinkState.LOOKING, message="held")
    journal.close()
    status = read_outcome(tmp_path)
    assert status.lines_total == len(OWN) + 11
    assert status.inserted == ((FIRST.after, 11),)
    assert status.file_line == OWN.file_line(done - 11)
    assert "it was held for a look, so its motors were at rest" in status.message


def test_ink_of_an_insert_is_taken_from_the_syringe():
    assert pushed_mm((FIRST,), FIRST.after) == 0.0
    assert pushed_mm((FIRST,), FIRST.after + 1) == pytest.approx(0.01)
    own, supply = np.array(plunger_travel(OWN.lines)), Supply(Filling(0, 1.0, 6.0), 2.0)
    across = np.array([False, *(b" X" in line for line in OWN.lines)])
    ink = 2.0 * np.cumsum(np.where(across, np.diff(own, prepend=0.0), 0.0))
    table = JobTable(*[own, ink, own, *[own] * 6])  # time and parts don't matter
    changed = {None: Filling(FIRST.after + 20, 0.5, 0.0)}
    for filled, begin, full in (({}, 0, 5.0), (changed, FIRST.after + 20, 5.5)):
        for flow in (1.0, 1.3):
            insert = replace(FIRST, flow=flow)
            pushed = plunger_travel(OWN.grown(insert).lines)
            journal = JournalledPrint(inserts=[insert], filled=filled)
            for done in (begin, *range(FIRST.after + 20, len(pushed), 3)):  # as the station counts
                left = 2.0 * (full - pushed[done] + pushed[begin])
                assert ink_left_ul(table, journal, done, supply) == pytest.approx(left, abs=1e-3)


def test_a_print_that_is_held_for_a_look_may_be_gone_on_with_by_the_operator(tmp_path):
    status = Status(LinkState.LOOKING, waits_for="a decision on look 3")
    can = {one.action: one.possible for one in possible_actions(tmp_path, status)}
    assert [can[one] for one in ("resume", "pause", "stop", "kill")] == [True] * 4
    assert not can["go_on"]
    assert waiting_lines(status) == ["waits for: a decision on look 3"]


# --- inserts that are refused, each with its reason; nothing of them is journalled or sent
AT = Modal(x=10.0, y=10.0, z=2.0, e=1.0, f=600.0)
LOW = ((0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0))
HIGH = ((0.0, 0.0), (50.0, 0.0), (50.0, 50.0), (0.0, 50.0))
REACH = JobReach(0.5, 8.0, LOW, high_hull_mm=HIGH)
PLACE = InsertPlace(AT, REACH, PRINTER)


@pytest.mark.parametrize(
    ("lines", "why"),
    [
        ([], "has 0 lines"),
        (["G28"], "G28 can't be injected"),
        (["M104 S0"], "M104 can't be injected: .* heaters"),
        (["M84"], "M84"),
        (["M83"], "relative extrusion"),
        (["M221 S110"], "M221"),
        (["T1"], "T1"),
        (["G92 X0"], "no other axis"),
        (["G1 X--5"], "X--5"),
        (["G1 X12\nM112"], "line end within a line"),
        (["G1 X12 F600"], "ends at X12 but the job continues from X10: go back to X10"),
        (["G1 E1.5 F60", "G1 F600"], "end it with G92 E1.00000"),
        (["G1 X12 F300", "G1 X10"], "end it with G1 F600"),
        (["G1 X12 F600000", "G1 X10 F600"], "mm/s of X exceeds"),
        (["G1 E3 F6000", "G1 E1", "G1 F600"], "mm/s of E exceeds"),
        (["G1 Z0.2", "G1 Z2"], "Z 0.2 mm is below 0.5 mm"),
        (["G1 Z9 F300", "G1 X60 Y10 F600", "G1 X10", "G1 Z2"], "X 60 Y 10 is more than"),
        (
            ["G1 X30", "G1 X10"],
            "below Z 8 mm and the needle|more than 1 mm beside all of the job's own moves",
        ),
        (["G1 Z8 F300", "G1 X900", "G1 X10", "G1 Z2"], "X 900.000 mm is outside"),
        (["G1 Z9 F300", "G1 X30 Y30", "G1 Z7"], "more than 1 mm beside|continues from"),
        (["G4 S100"], "a dwell of 100 s"),
        (["G2 X12 I1"], "G2"),
        (["G4 S60"] * 31, "more than 30 min"),
        (["G1 X12 F0.01", "G1 X10 F600"], "more than 30 min"),
        (["G1 E-19 F60", "G92 E1", "G1 F600"], "20 mm behind its position"),
        (["G1 E-4 F60", "G92 E1", "G1 F600"], "5 mm behind its start position"),
        ([*["G1 E45 F60", "G92 E1"] * 5, "G1 F600"], "mm are left"),
    ],
)
def test_refused_with_the_reason(lines, why):
    with pytest.raises(Refused, match=why):
        judged_lines(lines, PLACE, "the insert")


@pytest.mark.parametrize(
    ("flow", "why"),
    [(0.1, "outside 0.3 to 3"), (4.0, "outside 0.3 to 3"), (1.9, "would move at 7.6 mm/s")],
)
def test_flow_out_of_bounds_is_refused(flow, why):
    text = "G92 X10 Y10 Z2 E1\nG1 F600 X10\nG1 X11 E1.4\nG1 E9\nG1 X12 E9.1 F60\n"
    job = parse_job(text.encode(), "a")
    with pytest.raises(Refused, match=why):
        check_factor(flow, PLACE, "it")
        check_flow(job, job.grown(Insert(1, 2, (), "", flow)), PLACE, "it")


def test_flow_counts_arcs_with_their_length_and_goes_on_from_their_ends():
    """A half circle of 31.4 mm round X20 Y10, then 1 mm: pushes of 0.31 and 0.4 mm/s at flow 1."""
    text = "G92 X10 Y10 Z2 E1\nG1 F600 X10\nG3 X30 Y10 I10 J0 E2\nG1 X31 Y10 E2.04\n"
    job = parse_job(text.encode(), "a")
    place = InsertPlace(AT, REACH, PRINTER, plunger_mm_s=0.85)
    check_flow(job, job.grown(Insert(1, 2, (), "", 2.0)), place, "it")
    with pytest.raises(Refused, match=r"the plunger would move at 0\.88 mm/s"):
        check_flow(job, job.grown(Insert(1, 2, (), "", 2.2)), place, "it")


def test_reach_holds_the_touch_off_where_the_first_move_writes_and_the_fastest_push():
    """A count of the plunger before (G92 E) hides neither."""
    job = parse_job(b"G92 X10 Y10 Z2 E0\nG1 X30 Y10 E1 F600\nG1 X30 Y30 E1.5\n", "a")
    reach = JobReach.of(job.lines, (10.0, 10.0, 2.0))
    assert set(reach.hull_mm) == {(10.0, 10.0), (30.0, 10.0), (30.0, 30.0)}
    assert reach.push_mm_s == pytest.approx(0.5)


@pytest.mark.parametrize("by", [(0.0, 0.0, 0.0), (5.0, -3.0, 1.5)])
def test_places_are_counted_from_the_touch_off_where_the_job_renames_them(by):
    """The same job, whose second half calls places otherwise: the same is taken and refused."""
    x, y, z = by
    file = f"""G92 X10 Y10 Z2 E1
G1 X0 Y0 Z0.5 F600
G1 X20 Y20 E2
G1 X0 Y20
G1 X10 Y10 Z3
G1 Z2
G92 X{10 + x} Y{10 + y} Z{2 + z}
G1 X{5 + x} Y{5 + y}
G1 X{10 + x} Y{10 + y}
"""
    job = parse_job(file.encode(), "a")
    frame = frame_at(job, len(job), PRINTER)
    reach = JobReach.of(job.lines, None, frame.shift_at)
    assert (reach.low_mm, reach.top_mm) == (0.5, 3.0)
    assert reach.is_inside(1, 19, 1)
    assert not reach.is_inside(19, 1, 1)
    at = Modal(x=10.0 + x, y=10.0 + y, z=2.0 + z, e=2.0, f=600.0)
    place = InsertPlace(at, reach, PRINTER, shift_mm=frame.shift_at(len(job) - 1))
    back = [f"G1 X{10 + x} Y{10 + y} Z{2 + z} F300", "G1 F600"]
    assert len(judged_lines([f"G1 X{1 + x} Y{19 + y}", *back], place, "it")) == 3
    with pytest.raises(Refused, match="X 19 Y 1 is more than 1 mm beside"):
        judged_lines([f"G1 X{19 + x} Y{1 + y}", *back], place, "it")
    with pytest.raises(Refused, match=r"Z 0\.4 mm is below 0\.5 mm"):
        judged_lines([f"G1 Z{0.4 + z:.3f} F300", *back], place, "it")


def test_a_place_isnt_taken_as_renamed_before_the_jobs_own_renaming_behind_an_insert():
    """The frame was read once: an insert moved the renaming further down than was known."""
    job = parse_job(b"G92 X0 Y0 Z1\nG1 X10 F600\nG92 X0\nG1 X5\nG92 X0\nG1 X5\n", "a")
    protocol, x, steps_x = SimpleNamespace(lines_done=0, line_errors=0), 0.0, 0.0
    wiring = SimpleNamespace(protocol=protocol, printer=PRINTER, exchange=Exchange())
    progress = JobProgress(wiring, job)

    def command(text: bytes, journalled: bool = True) -> Steps[tuple[bytes, ...]]:
        yield from ()
        steps = int(steps_x * PRINTER.steps_per_mm.x)
        return (f"X:{x:.2f} Y:0.00 Z:1.00 E:0.00 Count X:{steps} Y:0 Z:400".encode(),)

    logbook = SimpleNamespace(
        progress=progress, fault="", excuse=lambda before: "", record=lambda sort, **values: True
    )
    frame = FrameCheck(SimpleNamespace(logbook=logbook, wiring=wiring, command=command))
    ended(frame.begin())
    protocol.lines_done, x, steps_x = 4, 5.0, 15.0
    assert not ended(frame.renamed())
    progress.grow(job.grown(Insert(1, 4, (b"G1 X7", b"G1 X9"))))
    protocol.lines_done, x, steps_x = 6, 9.0, 19.0
    assert not ended(frame.renamed())
