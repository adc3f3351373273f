"""Syringe change reported to a print whose link process died beforehand."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from printctl.errors import PrintctlError
from printctl.machine.link.care import Care
from printctl.machine.link.errors import PortMissing, Refused
from printctl.machine.link.journal import Journal
from printctl.machine.link.marks import MarkKind
from printctl.machine.link.process import hold_folder
from printctl.machine.link.record import JOURNAL, LinkRecord, load_record
from printctl.machine.link.resuming import resumable
from printctl.machine.link.states import LinkState
from printctl.machine.print_state.state import PrintTruth, read_print
from printctl.machine.printing.recovery import planned, write_rest
from printctl.observe.continue_print import continue_print
from printctl.observe.records import OBSERVER_LOCK, ORDER, READY, LookRecord, save_look
from printctl.observe.starting import ObserverError
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.test_stop_in_waits import JOB

module = sys.modules[continue_print.__module__]


def broken_off(folder: Path, wanted: str, **care) -> None:
    """Leave a print whose process was killed while the needle was being lifted."""
    file = folder / "a.gcode"
    file.write_text(JOB)
    job = parse_job(JOB.encode(), "a.gcode")
    record = LinkRecord(0, "", "", str(file), "generic_marlin", "/dev/nowhere", 0.0)
    replace(record, care=Care(**care).to_dict()).save(folder)
    journal = Journal(folder / JOURNAL)
    journal.add("job", sha256=job.sha256, lines=len(job))
    journal.add("state", state=LinkState.PRINTING, message="printing")
    journal.add("wanted", after=wanted)
    journal.add("state", state=LinkState.PAUSING, message="lifting the needle")
    journal.add("ack", done=30)
    journal.close()


@pytest.mark.parametrize(
    ("wanted", "then"),
    [("reload", "the change asked for is made first"), ("", "`printctl reload RUN` makes room")],
)
def test_it_is_refused_with_the_way_to_change(tmp_path, wanted, then):
    broken_off(tmp_path, wanted)
    with pytest.raises(PrintctlError, match=r"wasn't held for a change of syringe") as refused:
        continue_print(tmp_path, plunger_mm=0.0)
    assert then in str(refused.value)


def test_a_print_with_looks_does_not_go_on_without_an_observer_unless_told_so(tmp_path):
    broken_off(tmp_path, "", look_after=MarkKind.LAYER)
    (tmp_path / ORDER).write_text("{}")
    with pytest.raises(ObserverError, match=r"Nothing was moved.*--unobserved"):
        continue_print(tmp_path)
    assert not (tmp_path / READY).exists()
    with pytest.raises(PortMissing):  # so far it comes
        continue_print(tmp_path, unobserved=True)


@pytest.mark.parametrize(
    ("state", "started", "asked", "resumed"),
    [
        (LinkState.LOOKING, True, "", 0),  # else its picture is of a print that goes on
        (LinkState.LOOKING, False, "", 1),
        (LinkState.PAUSED, True, "", 1),
        (LinkState.PAUSED, True, "mend", 0),  # else the gap is lost with the observer that died
        (LinkState.PAUSED, False, "mend", 1),
    ],
)
def test_a_new_observer_makes_the_look_that_the_print_is_held_for(
    tmp_path, monkeypatch, state, started, asked, resumed
):
    said = []
    waits = "a decision" if state is LinkState.LOOKING else ""
    look = {"number": 4, "decision": "" if waits else "pause"}
    client = SimpleNamespace(
        status=SimpleNamespace(state=state, waits_for=waits, ended=False, look=look),
        resume=lambda *words: said.append(words),
    )
    save_look(tmp_path, LookRecord(4, 9, 9, "end of layer 1", 1.0, "pause", "1 gap", asked))
    monkeypatch.setattr(module, "attach", lambda _: nullcontext(client))
    monkeypatch.setattr(module, "ensure_observer", lambda _: started)
    assert continue_print(tmp_path) is client.status
    assert len(said) == resumed


@pytest.mark.parametrize(("unobserved", "resumed"), [(False, 0), (True, 1)])
def test_a_look_that_is_being_judged_is_not_gone_on_with(
    tmp_path, monkeypatch, unobserved, resumed
):
    said = []
    look = {"number": 4, "decision": "", "limit_s": 120.0}
    client = SimpleNamespace(
        status=SimpleNamespace(
            state=LinkState.LOOKING, waits_for="a decision", ended=False, look=look
        ),
        resume=lambda *words: said.append(words),
    )
    monkeypatch.setattr(module, "attach", lambda _: nullcontext(client))
    with hold_folder(tmp_path, OBSERVER_LOCK, "an observer is at work"):
        refused = pytest.raises(PrintctlError, match=r"look 4 is being judged.*120 s.*--unobserved")
        with nullcontext() if unobserved else refused:
            continue_print(tmp_path, unobserved=unobserved)
    assert len(said) == resumed


def test_of_a_print_that_failed_the_way_to_its_rest_is_told(tmp_path):
    broken_off(tmp_path, "")
    journal = Journal(tmp_path / JOURNAL)
    journal.add("end", state="failed", message="disk full", done=30, position_known=True)
    journal.close()
    with pytest.raises(Refused, match="`printctl recover` writes its rest"):
        resumable(tmp_path, parse_job(JOB.encode(), "a.gcode").sha256)


# --- true state of a stopped print: `stood`, if certain, says how much was printed
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
