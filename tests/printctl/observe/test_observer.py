"""Observer: what is said to the link after each decision, devices that fail, deaths in between."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from types import SimpleNamespace

import pytest

from printctl.machine.errors import LinkError, NoLink, Refused
from printctl.machine.records.states import LinkState, Status
from printctl.observe import process
from printctl.observe.deciding import Decider, FlowControl, Limits
from printctl.observe.deciding.evidence import ThinStretch
from printctl.observe.devices import DeviceSettings
from printctl.observe.looks.look_context import Look
from printctl.observe.observer import Observer
from printctl.observe.process import follow
from printctl.observe.records import (
    LookRecord,
    answer_look,
    read_answer,
    read_looks,
    save_look,
    total_words,
)
from tests.printctl.observe.observer_bench import GAP, LOOK, Bench

GO_ON, PAUSE, INSERT = ("go_on", 1), ("pause", 1), ("insert", 1, ("G1 X1 E1",), None)
MENDED = {"path": 2, "from_mm": 0.0, "to_mm": 1.0, "tries": 1}
THIN, CLOG_IN_PART = (ThinStretch(2, 0.0, 3.0, 0.3),), (ThinStretch(2, 0.0, 3.0, 0.6),)
ABOVE = "0.40 mm (another layer lies above)"


@pytest.mark.parametrize(
    ("bench", "said", "pictures", "words"),
    [
        ({}, [GO_ON], 1, "as expected"),
        ({"gaps": (GAP,)}, [INSERT, GO_ON], 2, "1 gap"),
        ({"gaps": (GAP,), "mended": (MENDED,)}, [(*INSERT, "again"), GO_ON], 2, ""),
        ({"gaps": (GAP,), "again": False}, [GO_ON], 2, "in one of two pictures alone"),
        ({"gaps": (GAP,), "refuses": True}, [PAUSE], 2, ""),
        ({"gaps": (GAP,), "lines": (), "left": ABOVE}, [PAUSE], 2, "can't be mended from here"),
        ({"thin": THIN}, [INSERT, GO_ON], 2, ""),
        ({"thin": THIN, "lines": ()}, [GO_ON], 2, ""),
        ({"thin": THIN, "one_each": True}, [GO_ON], 1, "by one picture"),
        ({"thin": CLOG_IN_PART, "lines": ()}, [PAUSE], 2, ""),
        ({"hangs": True}, [(*PAUSE, "again")], 0, "no picture"),
    ],
)
def test_a_look_tells_the_link_what_was_decided(tmp_path, bench, said, pictures, words):
    at = Bench(tmp_path, **bench)
    record = at.observer.look(LOOK)
    assert (at.link.said, len(at.pictures)) == (said, pictures)
    assert words in record.why
    assert read_looks(tmp_path) == [record]
    assert record.found.get("mended", []) == list(bench.get("mended", []))


def test_a_part_of_a_vessel_that_tells_little_is_left_to_the_next_look(tmp_path):
    bench = Bench(tmp_path, seen_share=0.1)
    part = [replace(LOOK, number=k, mark="end of a part of vessel 3") for k in range(1, 6)]
    records = [bench.observer.look(look) for look in part]
    assert bench.link.said == [("go_on", k) for k in range(1, 6)]
    assert "the next look judges it" in records[-1].why
    assert not any(one.has_judgement for one in read_looks(tmp_path))
    whole = bench.observer.look(replace(LOOK, number=6, mark="end of vessel 3, reload point"))
    assert whole.has_judgement
    broken = Bench(tmp_path, seen_share=0.1, gaps=(GAP,), over=True).observer.look(
        replace(part[0], number=7)
    )
    assert broken.has_judgement
    assert broken.decision != "go_on"


def test_a_picture_in_which_hardly_anything_is_seen_is_taken_anew(tmp_path):
    bench = Bench(tmp_path, gaps=(GAP,), seen_share=0.04)
    judge = bench.observer.judge

    def first_is_stale(look, picture, again):
        seen = judge(look, picture, again)
        if len(bench.pictures) > 1:
            return replace(seen, evidence=replace(seen.evidence, seen_share=0.9))
        return replace(seen, evidence=replace(seen.evidence, gaps=()))

    bench.observer.judge = first_is_stale
    assert bench.observer.look(LOOK).decision == "mend"
    assert bench.pictures == ["picture", "picture", "again"]


def test_a_look_that_somebody_ends_while_it_is_judged_keeps_nothing_of_its_pictures(tmp_path):
    bench = Bench(tmp_path, gaps=(GAP,))
    bench.observer.ended = lambda _: True
    bench.observer.look(LOOK)
    assert bench.link.said == []
    (record,) = read_looks(tmp_path)
    assert "not judged" in record.why
    assert not record.has_judgement


@pytest.mark.parametrize("seen_share", [0.9, 0.04])
@pytest.mark.parametrize("mode", ["mend", "ask"])
def test_a_gap_of_which_no_second_picture_comes_is_written_by_one(tmp_path, mode, seen_share):
    """A program that writes one file at each look; the look failed, and the gap stayed bare."""
    bench = Bench(
        tmp_path, mode, gaps=(GAP,), one_each=True, seen_share=seen_share,
        answer="approve" * (mode == "ask"),
    )  # fmt: skip
    bench.observer.look(LOOK)
    asked = [("pause", 1)] * (mode == "ask")
    assert bench.link.said[: len(asked) + 1] == [*asked, ("insert", 1, ("G1 X1 E1",), None)]
    (record,) = read_looks(tmp_path)
    assert record.has_judgement
    assert "1 gap, 1.00 mm" in record.why
    assert "by one picture: no new picture came into pics" in record.why


def test_the_flow_is_corrected_without_lines(tmp_path):
    bench = Bench(tmp_path, ratio=0.8)
    bench.observer.look(LOOK)
    (kind, _, lines, flow), done = bench.link.said
    assert (kind, lines, done) == ("insert", (), ("go_on", 1))
    assert flow == pytest.approx(1.25, abs=0.02)


def test_a_look_that_failed_is_recorded_and_leaves_the_control_as_it_was(tmp_path):
    bench = Bench(tmp_path, ratio=0.7)
    before = bench.observer.look(LOOK)
    again = replace(LOOK, number=2, done=200, before=100)
    bench.observer.decider.control.log_flow = 9.0  # decided, but not to be saved
    bench.observer.note_failure(again, "the observer failed: the disk is full")
    failed = read_looks(tmp_path)[-1]
    assert (failed.decision, failed.has_judgement) == ("pause", False)
    assert failed.control == before.control


def test_gaps_that_are_left_as_they_are_are_counted(tmp_path):
    for mode, word, left_mm in (
        ("tell", "", GAP.length_mm),
        ("ask", "go_on", GAP.length_mm),
        ("ask", "approve", None),
        ("mend", "", None),
    ):
        record = Bench(tmp_path, mode=mode, gaps=(GAP,), answer=word).observer.look(LOOK)
        assert record.found.get("left_mm") == left_mm
        told = total_words([record, replace(record, found={"seen_share": 0.0})])
        assert ("mm of gaps left" in told) == (left_mm is not None)
        assert told.startswith("2 looks: 2 ")
        assert told.endswith("of 1 less than 50% was seen")


@pytest.mark.parametrize("mode", ["mend", "ask"])
def test_what_a_mend_leaves_is_told(tmp_path, mode):
    left, answer = "0.22 mm (ink would reach into a lumen)", "approve" if mode == "ask" else ""
    bench = Bench(tmp_path, mode=mode, gaps=(GAP,), left=left, answer=answer)
    record = bench.observer.look(LOOK)
    assert record.why.endswith("; not mended: 0.22 mm (ink would reach into a lumen)")
    assert record.found["left_mm"] == 0.22
    assert read_looks(tmp_path) == [record]
    assert read_answer(tmp_path, 1) == ("approve" if mode == "ask" else None)


def test_looks_belong_to_their_print_when_the_clock_is_set_back(tmp_path):
    bench = Bench(tmp_path, ratio=0.8)
    now = bench.observer.clock()
    bench.observer.begun, bench.observer.clock = now, lambda: now - 3600.0
    bench.observer.look(LOOK)
    other = bench.another()
    other.begun = now
    other.restore_state(2)
    assert other.decider.control.flow == bench.observer.decider.control.flow != 1.0


def test_what_an_earlier_print_left_is_no_part_of_this_one(tmp_path):
    Bench(tmp_path, ratio=0.8).observer.look(LOOK)
    (tmp_path / "looks" / "0001" / "picture.tif").touch()
    bench = Bench(tmp_path)
    bench.observer.begun = read_looks(tmp_path)[0].at + 1.0
    bench.observer.restore_state(2)
    assert bench.observer.decider.control.flow == 1.0
    bench.observer.look(LOOK)
    assert not (tmp_path / "looks" / "0001" / "picture.tif").exists()


# --- answers of the operator to a look that asks, and what an observer does by them
@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("approve", [("insert", 1, ("G1 X1 E1",), None), ("resume",)]),
        ("go_on", [("resume",)]),
        ("stop", [("stop",)]),
    ],
)
def test_an_asked_operator_has_the_word(tmp_path, word, said):
    bench = Bench(tmp_path, mode="ask", gaps=(GAP,), answer=word)
    bench.observer.look(LOOK)
    assert bench.link.said == [("pause", 1), *said]


def test_a_look_has_one_answer(tmp_path):
    Bench(tmp_path, mode="ask", gaps=(GAP,), over=True).observer.look(LOOK)
    answer_look(tmp_path, 1, "approve")
    answer_look(tmp_path, 1, "approve")
    with pytest.raises(ValueError, match="answered before: approve"):
        answer_look(tmp_path, 1, "stop")
    assert read_answer(tmp_path, 1) == "approve"


def test_an_answer_that_a_full_disk_cut_is_written_again(tmp_path):
    Bench(tmp_path, mode="ask", gaps=(GAP,), over=True).observer.look(LOOK)
    answer_look(tmp_path, 1, "approve")
    (cut,) = tmp_path.glob("looks/*/answer.json")
    cut.write_text("")
    answer_look(tmp_path, 1, "go_on")
    assert read_answer(tmp_path, 1) == "go_on"


def test_a_print_that_went_on_by_itself_is_let_be(tmp_path):
    bench = Bench(tmp_path, mode="ask", gaps=(GAP,), over=True)
    bench.observer.look(LOOK)
    assert bench.link.said == [("pause", 1)]


def test_another_observer_asks_again_by_the_pictures(tmp_path):
    bench = Bench(tmp_path, mode="ask", gaps=(GAP,), over=True)
    bench.observer.look(LOOK)
    answer_look(tmp_path, 1, "approve")
    other = bench.another()
    other.restore_state(1)
    other.ask_again(LOOK)
    assert bench.link.said[1:] == [("insert", 1, ("G1 X1 E1",), None), ("resume",)]
    assert bench.pictures == ["picture", "again"]


def test_an_approval_that_cant_be_carried_out_is_told(tmp_path):
    bench = Bench(tmp_path, mode="ask", gaps=(GAP,), refuses=True, answer="approve")
    bench.observer.look(LOOK)
    assert bench.link.said == [("pause", 1)]
    (record,) = read_looks(tmp_path)
    assert "can't be mended" in record.why
    assert not record.asked


@pytest.mark.parametrize("word", ["approve", "go_on"])
def test_that_a_link_doesnt_go_on_by_an_answer_is_told(tmp_path, monkeypatch, word):
    bench = Bench(tmp_path, mode="ask", gaps=(GAP,), answer=word)
    monkeypatch.setattr(bench.link, "resume", _refusing("a change of syringe is to be told"))
    bench.observer.look(LOOK)
    (record,) = read_looks(tmp_path)
    assert "a change of syringe is to be told" in record.why
    assert [one[0] for one in bench.link.said] == ["pause", "insert"][: 1 + (word == "approve")]


def _refusing(why):
    def refuse():
        raise Refused(why)

    return refuse


def test_what_was_mended_in_vain_is_written_once_more_when_the_operator_approves(tmp_path):
    bench = Bench(tmp_path, gaps=(GAP,), in_vain=True, answer="approve")
    record = bench.observer.look(LOOK)
    assert record.asked == "mend"
    assert [one[0] for one in bench.link.said] == ["pause", "insert", "resume"]
    assert "not mended" not in read_looks(tmp_path)[-1].why


# --- observer's process: it looks once the needle is held, not while the motors still move
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
    follow(events.events(), observer, lambda: events.now)
    assert observer.looked == [(LinkState.LOOKING, 1.0)]


def test_a_look_that_was_decided_by_another_isnt_made(tmp_path):
    events = Events((LinkState.PAUSING, ""), (LinkState.PAUSED, "pause"))
    observer = watching(tmp_path, events)
    follow(events.events(), observer, lambda: events.now)
    assert observer.looked == []


@pytest.mark.parametrize("refusal", [Refused("not held for any"), LinkError("the print ended")])
def test_a_look_that_a_dead_link_took_away_is_made_again(tmp_path, refusal):
    first, second = (LinkState.LOOKING, ""), (LinkState.LOOKING, "")
    events = Events(first, (LinkState.PAUSING, ""), second, second)
    observer = watching(tmp_path, events, refusal)
    follow(events.events(), observer, lambda: events.now)
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
    follow(events.events(), observer, lambda: now.pop(0) if len(now) > 1 else now[0])
    assert len(observer.looked) == 1  # the motors may move by now


def test_a_link_that_is_too_busy_to_answer_is_believed_as_heard(tmp_path):
    events = Events((LinkState.LOOKING, ""))
    observer = watching(tmp_path, events)

    def now():
        raise NoLink("it doesn't answer")

    follow(events.events(), observer, now)
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
    follow(events.events(), observer, lambda: events.now)
    assert len(observer.looked) == times


def test_an_approved_mend_that_is_in_the_job_is_gone_on_with_and_not_planned_again(tmp_path):
    events = Events((LinkState.PAUSED, "pause"))
    observer = watching(tmp_path, events)
    observer.go_on = lambda number: observer.looked.append(f"gone on from {number}")
    save_look(tmp_path, LookRecord(1, 20, 20, "end", 0.0, "pause", "a gap", asked="mend"))
    look = {**TOLD, "decision": "pause", "insert_sha256": "1f"}
    follow(events.events(), observer, lambda: Status(LinkState.PAUSED, look=look))
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

    def decide(self, look, decision, why, again=False):
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
    follow([events.now], observer, lambda: events.now)
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
    follow(events.events(), observer, lambda: told[len(observer.looked)])
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
        process._acquire_in_time(job, Look(1, 9, 9, 0, "end of layer 0", now + left_s), tmp_path)
    assert limits == [80.0, 80.0, pytest.approx(30.0, abs=5.0), 1.0]
