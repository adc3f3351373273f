"""Observer: what is said to the link after each decision, devices that fail, deaths in between."""

from __future__ import annotations

from dataclasses import replace

import pytest

from printctl.observe.deciding.evidence import Thin
from printctl.observe.look_words import total_words
from printctl.observe.records import answer_of, read_looks
from tests.printctl.observe.observer_bench import GAP, LOOK, Bench, answering


def test_a_sound_layer_needs_one_picture(tmp_path):
    bench = Bench(tmp_path)
    bench.observer.look(LOOK)
    assert bench.link.said == [("go_on", 1)]
    assert bench.pictures == ["picture"]


def test_a_part_of_a_vessel_that_tells_little_is_left_to_the_next_look(tmp_path):
    bench = Bench(tmp_path, seen_share=0.1)
    part = [replace(LOOK, number=k, mark="end of a part of vessel 3") for k in range(1, 6)]
    records = [bench.observer.look(look) for look in part]
    assert bench.link.said == [("go_on", k) for k in range(1, 6)]
    assert "the next look judges it" in records[-1].why
    assert not any(one.judged for one in read_looks(tmp_path))
    whole = bench.observer.look(replace(LOOK, number=6, mark="end of vessel 3, reload point"))
    assert whole.judged
    broken = Bench(tmp_path, seen_share=0.1, gaps=(GAP,), over=True).observer.look(
        replace(part[0], number=7)
    )
    assert broken.judged
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
    assert not record.judged


def test_a_gap_in_two_pictures_is_mended_and_told(tmp_path):
    bench = Bench(tmp_path, gaps=(GAP,))
    record = bench.observer.look(LOOK)
    assert bench.link.said == [("insert", 1, ("G1 X1 E1",), None), ("go_on", 1)]
    assert bench.pictures == ["picture", "again"]
    assert record.decision == "mend"
    assert read_looks(tmp_path) == [record]


@pytest.mark.parametrize(("lines", "said"), [(["G1 X1 E1"], ["insert", "go_on"]), ([], ["go_on"])])
def test_thin_lines_are_looked_at_twice_and_never_stop_a_print(tmp_path, lines, said):
    bench = Bench(tmp_path, thin=(Thin(2, 0.0, 3.0, 0.3),), lines=lines)
    bench.observer.look(LOOK)
    assert [one[0] for one in bench.link.said] == said
    assert bench.pictures == ["picture", "again"]


def test_lines_that_lack_most_of_their_ink_and_cant_be_filled_up_pause(tmp_path):
    """A clog in part: 8 mm of a line with 36 % of its ink went on, told in the look's words."""
    bench = Bench(tmp_path, thin=(Thin(2, 0.0, 3.0, 0.6),), lines=[])
    bench.observer.look(LOOK)
    assert bench.link.said == [("pause", 1)]


@pytest.mark.parametrize("seen_share", [0.9, 0.04])
@pytest.mark.parametrize("mode", ["mend", "ask"])
def test_a_gap_of_which_no_second_picture_comes_is_asked_about(tmp_path, mode, seen_share):
    """A program that writes one file at each look; the look failed, and the gap stayed bare."""
    bench = Bench(tmp_path, mode, gaps=(GAP,), one_each=True, seen_share=seen_share)
    bench.link.look_done = answering(bench, "approve")
    bench.observer.look(LOOK)
    assert bench.link.said == [("pause", 1), ("insert", 1, ("G1 X1 E1",), None), ("resume",)]
    (record,) = read_looks(tmp_path)
    assert record.judged
    assert "1 gap, 1.00 mm" in record.why
    assert "by one picture: no new picture came into pics" in record.why


def test_thin_lines_of_which_no_second_picture_comes_are_left(tmp_path):
    bench = Bench(tmp_path, thin=(Thin(2, 0.0, 3.0, 0.3),), one_each=True)
    assert "by one picture" in bench.observer.look(LOOK).why
    assert bench.link.said == [("go_on", 1)]


def test_a_gap_in_one_picture_alone_isnt(tmp_path):
    bench = Bench(tmp_path, gaps=(GAP,), again=False)
    bench.observer.look(LOOK)
    assert bench.link.said == [("go_on", 1)]


def test_the_flow_is_corrected_without_lines(tmp_path):
    bench = Bench(tmp_path, ratio=0.8)
    bench.observer.look(LOOK)
    (kind, _, lines, flow), done = bench.link.said
    assert (kind, lines, done) == ("insert", (), ("go_on", 1))
    assert flow == pytest.approx(1.25, abs=0.02)


def test_a_refused_insert_pauses(tmp_path):
    bench = Bench(tmp_path, gaps=(GAP,), refuses=True)
    bench.observer.look(LOOK)
    assert bench.link.said == [("pause", 1)]


def test_a_device_that_hangs_pauses(tmp_path):
    bench = Bench(tmp_path, hangs=True)
    assert "no picture" in bench.observer.look(LOOK).why
    assert bench.link.said == [("pause", 1, "again")]


def test_a_look_behind_a_mend_is_asked_for_and_what_it_mends_is_recorded(tmp_path):
    mended = {"path": 2, "from_mm": 0.0, "to_mm": 1.0, "tries": 1}
    bench = Bench(tmp_path, gaps=(GAP,), mended=(mended,))
    bench.observer.look(LOOK)
    assert bench.link.said[0] == ("insert", 1, ("G1 X1 E1",), None, "again")
    (record,) = read_looks(tmp_path)
    assert record.found["mended"] == [mended]


def test_a_look_that_failed_is_recorded_and_leaves_the_control_as_it_was(tmp_path):
    bench = Bench(tmp_path, ratio=0.7)
    before = bench.observer.look(LOOK)
    again = replace(LOOK, number=2, done=200, before=100)
    bench.observer.decider.control.log_flow = 9.0  # decided, but not to be saved
    bench.observer.note_failure(again, "the observer failed: the disk is full")
    failed = read_looks(tmp_path)[-1]
    assert (failed.decision, failed.judged) == ("pause", False)
    assert failed.control == before.control


def test_the_failure_of_a_look_that_was_recorded_is_added_to_it(tmp_path):
    bench = Bench(tmp_path)
    kept = bench.observer.look(LOOK)
    bench.observer.note_failure(LOOK, "the observer failed")
    (record,) = read_looks(tmp_path)
    assert record.why == f"{kept.why}; the observer failed"


def test_gaps_that_are_left_as_they_are_are_counted(tmp_path, monkeypatch):
    for mode, word, left_mm in (
        ("tell", "", GAP.length_mm),
        ("ask", "go_on", GAP.length_mm),
        ("ask", "approve", None),
        ("mend", "", None),
    ):
        bench = Bench(tmp_path, mode=mode, gaps=(GAP,))
        if word:
            monkeypatch.setattr(bench.link, "look_done", answering(bench, word))
        record = bench.observer.look(LOOK)
        assert record.found.get("left_mm") == left_mm
        told = total_words([record, replace(record, found={"seen_share": 0.0})])
        assert ("mm of gaps left" in told) == (left_mm is not None)
        assert told.startswith("2 looks: 2 ")
        assert told.endswith("of 1 less than 50% was seen")


def test_why_nothing_was_seen_is_told(tmp_path):
    bench = Bench(tmp_path, not_seen="none of the lines lies in the picture; check the frame")
    assert "lies in the picture; check the frame" in bench.observer.look(LOOK).why


@pytest.mark.parametrize("mode", ["mend", "ask"])
def test_what_a_mend_leaves_is_told(tmp_path, monkeypatch, mode):
    bench = Bench(tmp_path, mode=mode, gaps=(GAP,), left="0.22 mm (ink would reach into a lumen)")
    if mode == "ask":
        monkeypatch.setattr(bench.link, "look_done", answering(bench, "approve"))
    record = bench.observer.look(LOOK)
    assert record.why.endswith("; not mended: 0.22 mm (ink would reach into a lumen)")
    assert record.found["left_mm"] == 0.22
    assert read_looks(tmp_path) == [record]
    assert answer_of(tmp_path, 1) == ("approve" if mode == "ask" else None)


def test_a_mend_that_is_impossible_is_recorded_as_a_pause(tmp_path):
    bench = Bench(tmp_path, gaps=(GAP,), lines=(), left="0.40 mm (another layer lies above)")
    record = bench.observer.look(LOOK)
    assert bench.link.said == [("pause", 1)]
    assert record.decision == "pause"
    assert "0.40 mm (another layer lies above); it can't be mended from here" in record.why


def test_another_observer_knows_the_flow(tmp_path):
    bench = Bench(tmp_path, ratio=0.8)
    bench.observer.look(LOOK)
    other = bench.another()
    other.remember(2)
    assert other.decider.control.flow == bench.observer.decider.control.flow != 1.0


def test_looks_belong_to_their_print_when_the_clock_is_set_back(tmp_path):
    bench = Bench(tmp_path, ratio=0.8)
    now = bench.observer.clock()
    bench.observer.begun, bench.observer.clock = now, lambda: now - 3600.0
    bench.observer.look(LOOK)
    other = bench.another()
    other.begun = now
    other.remember(2)
    assert other.decider.control.flow == bench.observer.decider.control.flow != 1.0


def test_what_an_earlier_print_left_is_no_part_of_this_one(tmp_path):
    Bench(tmp_path, ratio=0.8).observer.look(LOOK)
    (tmp_path / "looks" / "0001" / "picture.tif").touch()
    bench = Bench(tmp_path)
    bench.observer.begun = read_looks(tmp_path)[0].at + 1.0
    bench.observer.remember(2)
    assert bench.observer.decider.control.flow == 1.0
    bench.observer.look(LOOK)
    assert not (tmp_path / "looks" / "0001" / "picture.tif").exists()
