"""Answers of the operator to a look that asks, and what an observer does by them."""

from __future__ import annotations

import pytest

from printctl.machine.link.errors import Refused
from printctl.observe.records import answer_look, answer_of, read_looks
from tests.printctl.observe.observer_bench import GAP, LOOK, Bench, answering


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("approve", [("insert", 1, ("G1 X1 E1",), None), ("resume",)]),
        ("go_on", [("resume",)]),
        ("stop", [("stop",)]),
    ],
)
def test_an_asked_operator_has_the_word(tmp_path, monkeypatch, word, said):
    bench = Bench(tmp_path, mode="ask", gaps=(GAP,))
    monkeypatch.setattr(bench.link, "look_done", answering(bench, word))
    bench.observer.look(LOOK)
    assert bench.link.said == [("pause", 1), *said]


def test_a_look_has_one_answer(tmp_path):
    Bench(tmp_path, mode="ask", gaps=(GAP,), over=True).observer.look(LOOK)
    answer_look(tmp_path, 1, "approve")
    answer_look(tmp_path, 1, "approve")
    with pytest.raises(ValueError, match="answered before: approve"):
        answer_look(tmp_path, 1, "stop")
    assert answer_of(tmp_path, 1) == "approve"


def test_an_answer_that_a_full_disk_cut_is_written_again(tmp_path):
    Bench(tmp_path, mode="ask", gaps=(GAP,), over=True).observer.look(LOOK)
    answer_look(tmp_path, 1, "approve")
    (cut,) = tmp_path.glob("looks/*/answer.json")
    cut.write_text("")
    answer_look(tmp_path, 1, "go_on")
    assert answer_of(tmp_path, 1) == "go_on"


def test_a_print_that_went_on_by_itself_is_let_be(tmp_path):
    bench = Bench(tmp_path, mode="ask", gaps=(GAP,), over=True)
    bench.observer.look(LOOK)
    assert bench.link.said == [("pause", 1)]


def test_another_observer_asks_again_by_the_pictures(tmp_path):
    bench = Bench(tmp_path, mode="ask", gaps=(GAP,), over=True)
    bench.observer.look(LOOK)
    answer_look(tmp_path, 1, "approve")
    other = bench.another()
    other.remember(1)
    other.ask_again(LOOK)
    assert bench.link.said[1:] == [("insert", 1, ("G1 X1 E1",), None), ("resume",)]
    assert bench.pictures == ["picture", "again"]


def test_an_approval_that_cant_be_carried_out_is_told(tmp_path, monkeypatch):
    bench = Bench(tmp_path, mode="ask", gaps=(GAP,), refuses=True)
    monkeypatch.setattr(bench.link, "look_done", answering(bench, "approve"))
    bench.observer.look(LOOK)
    assert bench.link.said == [("pause", 1)]
    (record,) = read_looks(tmp_path)
    assert "can't be mended" in record.why
    assert not record.asked


@pytest.mark.parametrize("word", ["approve", "go_on"])
def test_that_a_link_doesnt_go_on_by_an_answer_is_told(tmp_path, monkeypatch, word):
    bench = Bench(tmp_path, mode="ask", gaps=(GAP,))
    monkeypatch.setattr(bench.link, "look_done", answering(bench, word))
    monkeypatch.setattr(bench.link, "resume", _refusing("a change of syringe is to be told"))
    bench.observer.look(LOOK)
    (record,) = read_looks(tmp_path)
    assert "a change of syringe is to be told" in record.why
    assert [one[0] for one in bench.link.said] == ["pause", "insert"][: 1 + (word == "approve")]


def _refusing(why):
    def refuse():
        raise Refused(why)

    return refuse


def test_what_was_mended_in_vain_is_written_once_more_when_the_operator_approves(
    tmp_path, monkeypatch
):
    bench = Bench(tmp_path, gaps=(GAP,), in_vain=True)
    monkeypatch.setattr(bench.link, "look_done", answering(bench, "approve"))
    record = bench.observer.look(LOOK)
    assert record.asked == "mend"
    assert [one[0] for one in bench.link.said] == ["pause", "insert", "resume"]
    assert "not mended" not in read_looks(tmp_path)[-1].why


def test_what_was_mended_in_vain_stays_as_it_is_when_the_operator_says_go_on(tmp_path, monkeypatch):
    bench = Bench(tmp_path, gaps=(GAP,), in_vain=True)
    monkeypatch.setattr(bench.link, "look_done", answering(bench, "go_on"))
    bench.observer.look(LOOK)
    assert [one[0] for one in bench.link.said] == ["pause", "resume"]
    kept = read_looks(tmp_path)[-1]
    assert "written 2 times more" in kept.why
    assert kept.found["left_mm"] == 1.0  # all of it, what could have been mended included
