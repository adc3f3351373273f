"""True state of a stopped print: `stood`, if certain, says how much was printed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from printctl.errors import PrintctlError
from printctl.machine.link.care import Care
from printctl.machine.link.journal import Journal
from printctl.machine.link.marks import MarkKind
from printctl.machine.link.record import JOURNAL, LinkRecord, load_record
from printctl.machine.link.states import LinkState
from printctl.machine.print_state.state import PrintTruth, read_print
from printctl.machine.printing.recovery import planned, write_rest
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.test_stop_in_waits import JOB

TAKEN, STOOD = 30, 17


def left_behind(folder: Path, state: LinkState, stood: dict[str, Any] | None) -> PrintTruth:
    """What is told of a print whose process ended before it could leave its last status."""
    file = folder / "a.gcode"
    file.write_text(JOB)
    job = parse_job(JOB.encode(), "a.gcode")
    LinkRecord(0, "", "", str(file), "generic_marlin", "", 0.0).save(folder)
    journal = Journal(folder / JOURNAL)
    journal.add("job", sha256=job.sha256, lines=len(job))
    journal.add("state", state=LinkState.PRINTING, message="printing")
    journal.add("ack", done=TAKEN)
    if stood is not None:
        journal.add("stood", done=TAKEN, begin_at=None, dropped=True, **stood)
    journal.add("end", state=state, message="", done=TAKEN, error="", position_known=True)
    journal.close()
    return read_print(folder)


@pytest.mark.parametrize(
    ("stood", "made"),
    [
        ({"line": STOOD, "certain": True}, STOOD),
        ({"line": 11, "certain": False}, 10),  # 20 moves may have been ahead
        (None, 10),
    ],
)
def test_moves_that_a_stop_dropped_count_as_not_made(tmp_path, stood, made):
    truth = left_behind(tmp_path, LinkState.STOPPED, stood)
    assert truth.status.lines_executed == made
    assert truth.share == pytest.approx(made / truth.status.lines_total)
    assert truth.words["made"] == f"at least {made} of {truth.status.lines_total} lines made"
    assert truth.to_dict()["lines_executed"] == made


def test_a_print_that_was_done_was_made_whole(tmp_path):
    assert left_behind(tmp_path, LinkState.DONE, None).status.lines_executed == TAKEN


def test_a_print_of_which_no_line_was_sent_has_nothing_to_recover(tmp_path):
    file = tmp_path / "a.gcode"
    file.write_text(JOB)
    job = parse_job(JOB.encode(), "a.gcode")
    LinkRecord(0, "", "", str(file), "generic_marlin", "", 0.0).save(tmp_path)
    journal = Journal(tmp_path / JOURNAL)
    journal.add("job", sha256=job.sha256, lines=len(job))
    journal.add("state", state=LinkState.CHECKING, message="asking the firmware what it is")
    journal.close()
    assert "print it anew" in read_print(tmp_path).status.message
    assert "Recover" not in read_print(tmp_path).status.message
    with pytest.raises(PrintctlError, match="no line of the job was sent"):
        planned(tmp_path, 3)


@pytest.mark.parametrize("care", [Care(), Care(look_after=MarkKind.LAYER)])
def test_of_an_observed_print_it_is_told_that_nobody_looks_at_the_rest(tmp_path, care):
    """Command line and page told the plan's steps, which left it out."""
    left_behind(tmp_path, LinkState.STOPPED, None)
    replace(load_record(tmp_path), care=care.to_dict()).save(tmp_path)
    plan = planned(tmp_path, 20)
    told = [step for step in plan.steps if "nobody looks at the rest" in step]
    assert len(told) == (1 if care.looks else 0)
    written = write_rest(tmp_path, plan)
    assert written["steps"] == list(plan.steps)
