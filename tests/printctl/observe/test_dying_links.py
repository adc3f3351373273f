"""Links that die in a look whose observer finishes before the next link is there."""

from __future__ import annotations

import os
import signal
import threading
from contextlib import nullcontext

import pytest
import yaml

from firmware_profiles import Printer, load
from printctl.link import LinkState, resume_print, start_print
from printctl.link.care import Care
from printctl.link.find_link import alive
from printctl.link.journal import read_records
from printctl.link.journalled_print import read_journal
from printctl.link.marks import MarkKind
from printctl.link.process import hold_folder
from printctl.link.record import JOURNAL
from printctl.observe import process
from printctl.observe.deciding import Decider, FlowControl, Limits
from printctl.observe.observer import Judged, MendLines, Observer
from printctl.observe.records import OBSERVER_LOCK, ORDER, RESUMED, read_looks
from printctl.observe.starting import ensure_observer
from tests.printctl.link.fake_marlin import FakeMarlin, pty_printer
from tests.printctl.link.jobs import parse_job
from tests.printctl.link.looking import layered, patch
from tests.printctl.observe.test_observer import GAP, evidence

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals here")
LIMIT_S = 60.0


class Slow:
    """An observer's process in a thread; it judges its first picture until it is let go on."""

    def __init__(self, run, lines, monkeypatch) -> None:
        self.run, self.lines = run, lines
        self.judging, self.go_on, self.unheard = (threading.Event() for _ in range(3))
        self.pictures: list[int] = []
        self.thread = threading.Thread(target=self.observe)
        self.waits = 0
        monkeypatch.setattr(process, "_await_print", self.await_print)

    def observe(self) -> None:
        with hold_folder(self.run, OBSERVER_LOCK, "an observer is at work"):
            process.follow_links(self.run, self.assembled)
        self.unheard.set()

    def await_print(self, folder, wait=process._await_print) -> None:
        """As ever; tells that the observer knows of the first link's death."""
        self.waits += 1
        if self.waits > 1:
            self.unheard.set()
        wait(folder)

    def assembled(self, words) -> Observer:
        return Observer(
            self.run, process.LinkWords(words), self.acquire, self.judge,
            lambda *_: MendLines(tuple(self.lines)), Decider(Limits(mend="mend"), FlowControl()),
            lambda _: False,
        )  # fmt: skip

    def acquire(self, look, out):
        if out.name == "picture":
            self.pictures.append(look.number)
        out.with_suffix(".png").touch()
        return out.with_suffix(".png")

    def judge(self, look, picture, again) -> Judged:
        self.judging.set()
        assert self.go_on.wait(LIMIT_S)
        gaps = (GAP,) if look.number == 1 else ()
        one = evidence(gaps)
        return Judged(type(one)(**{**vars(one), "second": again and gaps}), {"seen_share": 0.9})


@pytest.mark.parametrize("heard", ["after the death", "after the resume was asked for"])
def test_a_look_judged_before_the_next_link_is_there_is_decided_and_mended_once(
    tmp_path, monkeypatch, heard
):
    data, job, run = layered(2, 6), tmp_path / "job.gcode", tmp_path / "run"
    job.write_bytes(data)
    facts = load(Printer, "generic_marlin").model_copy(update={"resets_on_connect": False})
    profile = tmp_path / "test.yaml"
    profile.write_text(yaml.safe_dump(facts.model_dump(mode="json")))
    care = Care(checkpoint_s=None, look_after=MarkKind.LAYER, look_limit_s=300)
    with pty_printer(FakeMarlin()) as served:
        client = start_print(job, str(profile), served.name, run, care=care)
        (run / ORDER).write_text("{}")
        slow = Slow(run, patch(data, 0), monkeypatch)
        slow.thread.start()
        assert slow.judging.wait(LIMIT_S)
        os.kill(client.record.pid, signal.SIGKILL)
        client.wait(30)
        assert not alive(run)
        if heard == "after the death":
            ensure_observer(run)
            slow.go_on.set()  # no link is there: what it decides reaches nobody
            assert slow.unheard.wait(LIMIT_S)
            assert slow.thread.is_alive(), "it ended, and nobody looks for the next link"
            client = resume_print(run, served.name)
        else:
            ensure_observer(run)
            client = resume_print(run, served.name)
            slow.go_on.set()
        assert client.wait(LIMIT_S).state is LinkState.DONE
        slow.thread.join(LIMIT_S)
        assert not slow.thread.is_alive()
    decided = [one["look"] for one in read_records(run / JOURNAL) if one and one["t"] == "looked"]
    assert decided == [1, 2]
    inserts = read_journal(run / JOURNAL).inserts
    assert [one.look for one in inserts] == [1]
    grown = parse_job(data, "a").grown_by(inserts)
    written = [line for line in served.printer.numbered if " X" in line]
    assert written == [line.decode() for line in grown.lines if b" X" in line]
    assert [one.decision for one in read_looks(run)] == ["mend", "go_on"]
    if heard == "after the death":
        assert slow.pictures == [1, 1, 2]
        assert not (run / RESUMED).exists()


@pytest.mark.parametrize(("resumed", "links"), [(False, 1), (True, 2)])
def test_an_observer_stays_for_another_link_where_somebody_resumes(
    tmp_path, monkeypatch, resumed, links
):
    served = []
    monkeypatch.setattr(process, "_await_print", served.append)
    monkeypatch.setattr(process, "follow", lambda events, observer: LinkState.INTERRUPTED)
    monkeypatch.setattr(process, "attach", lambda folder: nullcontext())
    if resumed:
        (tmp_path / RESUMED).touch()
    process.follow_links(tmp_path, lambda words: None)
    assert len(served) == links
    assert not (tmp_path / RESUMED).exists()
