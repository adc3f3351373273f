"""Stop position of a printer in its job, and the rest by `recover`."""

from __future__ import annotations

import numpy as np
import pytest

from printctl.machine.link.errors import LinkError
from printctl.machine.link.journalled_print import JournalledPrint, read_journal
from printctl.machine.link.modal import Modal
from printctl.machine.link.recovering import plan_recovery
from printctl.machine.link.stop_place import StopPlace, find_stop_line
from sim.gcode.dry_run.run import dry_run
from sim.gcode.motion.executed import ExecutedMotion
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.test_stop_in_waits import HEADER, MARLIN, RETREAT, Moment, stopped

LINES = [b"G1 X10 Y0 Z1 E1", b"G1 X10 Y10 E2", b"G1 X0 Y10 E3", b"G1 X0 Y0 E4", b"G1 X10 Y0 E5"]
PLACED = [b"G92 X0 Y0 Z1 E0", *LINES]
JOB = HEADER + "".join(
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
    status, wire = stopped(Moment(b"G1 X", after_s, count), tmp_path, job=JOB)
    history = read_journal(tmp_path / "journal.log")
    assert history.stood is not None
    assert history.stood["certain"], history.stood
    job = parse_job(JOB.encode(), "test.gcode")
    plan = plan_recovery(job, JOB.encode(), history, MARLIN, RETREAT)
    first = wire.printer.executed()
    rest = dry_run(plan.gcode, MARLIN, (50.0, 50.0, 10.0), cold_extrusion=True).executed
    whole = written(dry_run(JOB.encode(), MARLIN, (50.0, 50.0, 10.0)).executed)
    made = np.add(written(first), written(rest))
    assert made[0] == pytest.approx(whole[0], abs=0.05)
    assert made[1] == pytest.approx(whole[1], abs=0.003)
    told = " ".join(plan.steps)
    assert "nothing is left out or written twice" in told, status


def test_a_stop_in_a_pause_goes_on_with_the_next_line(tmp_path):
    stopped(Moment(b"G1 Z", 0.2, count=3), tmp_path, job=JOB)
    history = read_journal(tmp_path / "journal.log")
    assert history.stood is not None
    assert (history.stood["line"], history.stood["certain"]) == (history.done, True)


def test_nothing_is_left_of_a_job_whose_lines_were_all_made():
    job = parse_job(JOB.encode(), "a")
    stood = {"line": len(job), "begin_at": None, "certain": True, "dropped": False}
    history = JournalledPrint(done=len(job), stood=stood)
    with pytest.raises(LinkError, match="every line"):
        plan_recovery(job, JOB.encode(), history, MARLIN, RETREAT)


@pytest.mark.parametrize("after_s", [0.3, 4.7])
def test_lines_that_were_certainly_made_before_a_stop_are_told_as_made(tmp_path, after_s):
    """`stood` counts them; the planner may have held each of them when it was told to drop all."""
    status, _ = stopped(Moment(b"G1 X", after_s, 20), tmp_path, job=JOB)
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
    plan = plan_recovery(job, EACH.encode(), history, MARLIN, RETREAT)
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
    plan = plan_recovery(read, job.encode(), history, MARLIN, RETREAT, ul_per_mm=10.0)
    told = "at most 25.7 mm of path and 10.00 µL (1.000 mm of plunger), lines 7 to 9."
    assert f"Written twice may be {told}" in plan.steps[-1]
