"""Syringe change reported to a print whose link process died beforehand."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from printctl.errors import PrintctlError
from printctl.machine.link.care import Care
from printctl.machine.link.errors import PortMissing, Refused
from printctl.machine.link.journal import Journal
from printctl.machine.link.marks import MarkKind
from printctl.machine.link.process import hold_folder
from printctl.machine.link.record import JOURNAL, LinkRecord
from printctl.machine.link.resuming import resumable
from printctl.machine.link.states import LinkState
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


def test_a_print_without_looks_asks_for_no_observer(tmp_path):
    broken_off(tmp_path, "")
    (tmp_path / ORDER).write_text("{}")
    with pytest.raises(PortMissing):
        continue_print(tmp_path)


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
