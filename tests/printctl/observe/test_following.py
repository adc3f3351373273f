"""Observer's process: it looks once the needle is held, not while the motors still move."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from types import SimpleNamespace

import pytest

from printctl.machine.link.errors import LinkError, NoLink, Refused
from printctl.machine.link.states import LinkState, Status
from printctl.observe import process
from printctl.observe.deciding import Decider, FlowControl, Limits
from printctl.observe.devices import DeviceSettings
from printctl.observe.look_values import Look
from printctl.observe.observer import Observer
from printctl.observe.process import follow
from printctl.observe.records import LookRecord, answer_look, save_look

TOLD = {
    "number": 1, "mark": "end of layer 0", "done": 20, "decision": "", "insert_sha256": "",
    "limit_s": 120.0,
}  # fmt: skip


class Events:
    """Statuses in their order; ``now`` is the one that is being heard."""

    def __init__(self, *said: tuple[LinkState, str]) -> None:
        self.now: Status | None = None
        self.said = said

    def events(self):
        for state, decision in self.said:
            self.now = Status(state, look={**TOLD, "decision": decision})
            yield self.now
        yield Status(LinkState.DONE)


class Watching(Observer):
    """Notes in which state it looks, and what flow it takes to be in force; may be refused."""

    def look(self, look):
        self.looked.append((self.events.now.state, round(self.decider.control.factor, 3)))
        self.decider.control.log_flow += 0.5
        if self.refusals:
            raise self.refusals.pop()
        return LookRecord(look.number, look.done, look.job_line, look.mark, 0.0, "go_on", "")


def watching(folder, events, *refusals) -> Watching:
    (folder / "journal.log").touch()
    decider = Decider(Limits(), FlowControl())
    observer = Watching(folder, None, None, None, None, decider, None)
    observer.events, observer.looked, observer.refusals = events, [], list(refusals)
    return observer


@pytest.mark.parametrize("held", [1, 3])
def test_a_picture_is_taken_once_the_needle_is_held(tmp_path, held):
    pausing, looking = (LinkState.PAUSING, ""), (LinkState.LOOKING, "")
    events = Events(pausing, pausing, *[looking] * held, (LinkState.RESUMING, "go_on"))
    observer = watching(tmp_path, events)
    follow(events, observer, lambda: events.now)
    assert observer.looked == [(LinkState.LOOKING, 1.0)]


def test_a_look_that_was_decided_by_another_isnt_made(tmp_path):
    events = Events((LinkState.PAUSING, ""), (LinkState.PAUSED, "pause"))
    observer = watching(tmp_path, events)
    follow(events, observer, lambda: events.now)
    assert observer.looked == []


@pytest.mark.parametrize("refusal", [Refused("not held for any"), LinkError("the print ended")])
def test_a_look_that_a_dead_link_took_away_is_made_again(tmp_path, refusal):
    first, second = (LinkState.LOOKING, ""), (LinkState.LOOKING, "")
    events = Events(first, (LinkState.PAUSING, ""), second, second)
    observer = watching(tmp_path, events, refusal)
    follow(events, observer, lambda: events.now)
    assert observer.looked == [(LinkState.LOOKING, 1.0)] * 2  # its picture counts once


@pytest.mark.parametrize(
    ("state", "decision"), [(LinkState.PAUSED, "pause"), (LinkState.PRINTING, "")]
)
def test_a_look_that_is_over_isnt_made_for_what_was_said_meanwhile(tmp_path, state, decision):
    looking = (LinkState.LOOKING, "")
    events = Events(*[looking] * 4)
    observer = watching(tmp_path, events, *[Refused("decided before: pause")] * 4)
    look = {**TOLD, "decision": decision} if decision else None
    now = [Status(LinkState.LOOKING, look=TOLD), Status(state, look=look)]
    follow(events, observer, lambda: now.pop(0) if len(now) > 1 else now[0])
    assert len(observer.looked) == 1  # the motors may move by now


def test_a_link_that_is_too_busy_to_answer_is_believed_as_heard(tmp_path):
    events = Events((LinkState.LOOKING, ""))
    observer = watching(tmp_path, events)

    def now():
        raise NoLink("it doesn't answer")

    follow(events, observer, now)
    assert observer.looked == [(LinkState.LOOKING, 1.0)]


class Asking(Watching):
    """A look's approved mend goes into a print whose link then fails or refuses to go on."""

    def ask_again(self, look):
        self.look(look)


@pytest.mark.parametrize(
    ("failure", "times"), [(Refused("the bed is at 12 °C"), 1), (LinkError("it died"), 2)]
)
def test_what_was_approved_is_tried_again_after_a_dead_link_alone(tmp_path, failure, times):
    paused = (LinkState.PAUSED, "pause")
    events = Events(paused, paused, paused)
    observer = watching(tmp_path, events, failure)
    observer.__class__ = Asking
    record = LookRecord(1, 20, 20, "end of layer 0", 0.0, "pause", "a gap", asked="mend")
    save_look(tmp_path, record)
    follow(events, observer, lambda: events.now)
    assert len(observer.looked) == times


def test_an_approved_mend_that_is_in_the_job_is_gone_on_with_and_not_planned_again(tmp_path):
    events = Events((LinkState.PAUSED, "pause"))
    observer = watching(tmp_path, events)
    observer.go_on = lambda number: observer.looked.append(f"gone on from {number}")
    save_look(tmp_path, LookRecord(1, 20, 20, "end", 0.0, "pause", "a gap", asked="mend"))
    look = {**TOLD, "decision": "pause", "insert_sha256": "1f"}
    follow(events, observer, lambda: Status(LinkState.PAUSED, look=look))
    assert observer.looked == ["gone on from 1"]


class FullDisk(Watching):
    """Can't save the record of its first look."""

    def look(self, look):
        self.looked.append(look.before)
        if len(self.looked) == 1:
            raise OSError(28, "No space left on device")
        return LookRecord(look.number, look.done, look.job_line, look.mark, 0.0, "go_on", "")


class Link:
    """Notes what it is told."""

    def __init__(self) -> None:
        self.said: list[tuple[object, ...]] = []

    def look_done(self, look, decision, why, again=False):
        self.said.append((look, decision, again, "the disk is full" in why))


@pytest.mark.parametrize(
    ("answer", "at"), [("go_on", 20), ("approve", 20), ("go_on", 10), ("", 20)]
)
def test_a_question_that_was_answered_while_the_syringe_was_changed_isnt_asked_again(
    tmp_path, answer, at
):
    """The word was go on without; the look is made again behind the change."""
    events, look = Events(), {**TOLD, "number": 2}
    observer = watching(tmp_path, events)
    observer.link, events.now = Link(), Status(LinkState.LOOKING, look=look)
    asked = LookRecord(1, at, at, "end", 0.0, "pause", "a gap", asked="mend")
    save_look(tmp_path, replace(asked, control=observer._new))
    if answer:
        answer_look(tmp_path, 1, answer)
    follow(SimpleNamespace(events=lambda: [events.now]), observer, lambda: events.now)
    told = (answer, at) == ("go_on", 20)
    assert observer.link.said == ([(2, "go_on", False, False)] if told else [])
    assert len(observer.looked) == (0 if told else 1)


@pytest.mark.parametrize("frees", [True, False])
def test_a_look_whose_record_a_full_disk_refused_is_to_be_made_again(tmp_path, monkeypatch, frees):
    look = {**TOLD, "number": 2, "done": 20}
    events = Events()
    observer = watching(tmp_path, events)
    observer.__class__, observer.link = FullDisk, Link()
    judged = LookRecord(1, 10, 10, "end", 0.0, "go_on", "", found={"seen_share": 1.0})
    save_look(tmp_path, replace(judged, control=observer._new))
    if not frees:
        monkeypatch.setattr(
            "printctl.observe.observer.save_look", lambda *_: (_ for _ in ()).throw(OSError(28))
        )
    told = [Status(LinkState.LOOKING, look={**look, "number": number}) for number in (2, 3)]
    events.events = lambda: iter(told)
    follow(events, observer, lambda: told[len(observer.looked)])
    assert observer.link.said == [(2, "pause", True, True)]
    assert observer.looked == [10, 10]  # what was written since the last look that was judged


def test_pictures_of_a_look_share_the_time_that_it_has(monkeypatch, tmp_path):
    """A second one was waited for as long as a first: the link's limit was over before."""
    limits = []
    monkeypatch.setattr(process, "acquire", lambda device, out, _: limits.append(device.limit_s))
    order = SimpleNamespace(device=DeviceSettings("folder", limit_s=80.0), tells_heights=False)
    job = SimpleNamespace(order=order)
    now = time.monotonic()
    for left_s in (math.inf, 300.0, 30.0, -5.0):
        process._acquired(job, Look(1, 9, 9, 0, "end of layer 0", now + left_s), tmp_path)
    assert limits == [80.0, 80.0, pytest.approx(30.0, abs=5.0), 1.0]
