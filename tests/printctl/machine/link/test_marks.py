"""Interruption marks in a job (ours and slicers'), and holds at them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printctl.machine.link.care import Care
from printctl.machine.link.marks import Mark, MarkKind, Marks
from printctl.machine.link.watch import DueTask, Watch
from tests.printctl.machine.link.jobs import parse_job


def test_marks_stand_between_command_lines():
    text = b"G90\n;LAYER_END:0\n;RELOAD\nG1 X1\n\n;PART_END:3\n;PASS_END:12\r\nG1 X2\n"
    job = parse_job(text, "a")
    assert job.marks.all == (
        Mark(1, MarkKind.LAYER, 0),
        Mark(1, MarkKind.RELOAD),
        Mark(2, MarkKind.PART, 3),
        Mark(2, MarkKind.VESSEL, 12),
    )
    assert [str(mark) for mark in job.marks.all] == [
        "end of layer 1",
        "reload point",
        "end of a part of vessel 3",
        "end of vessel 12",
    ]


@pytest.mark.parametrize(
    ("text", "number"),
    [
        (b";LAYER:%d", 4),
        (b";LAYER_CHANGE", -1),
        (b"; CHANGE_LAYER", -1),
        (b"; layer %d, Z = 0.600", 3),
    ],
)
def test_slicers_layers_end_where_the_next_one_begins(text, number):
    begins = [text.replace(b"%d", b"%d" % k) for k in (4, 5)]
    job = parse_job(b"G90\n" + begins[0] + b"\nG1 X1\n" + begins[1] + b"\nG1 X2\n", "a")
    assert job.marks.all == (Mark(2, MarkKind.LAYER, number),)


@pytest.mark.parametrize("text", [b";LAYERS:5", b"; a layer", b";LAYER_ENDING:1", b"G1 X2 ;RELOAD"])
def test_other_comments_are_no_marks(text):
    assert len(parse_job(b"G90\n" + text + b"\nG1 X1\n" + text + b"\n", "a").marks) == 0


marks = st.lists(st.builds(Mark, st.integers(0, 40), st.sampled_from(MarkKind)), max_size=15).map(
    lambda found: sorted(found, key=lambda mark: mark.index)
)


@given(marks, st.integers(0, 41), st.sampled_from(MarkKind))
def test_search_agrees_with_a_walk(found, index, kind):
    of = [mark for mark in found if mark.kind is kind]
    searched = Marks(found)
    assert searched.next(kind, index) == next((m for m in of if m.index >= index), None)
    before = [m.index for m in of if m.index <= index]
    last = searched.last(kind, index)
    assert (last.index if last else None) == (before[-1] if before else None)
    assert {m.kind for m in searched.here(index)} == {m.kind for m in found if m.index == index}


@given(marks, st.integers(0, 40), st.sampled_from(MarkKind), st.booleans())
def test_no_mark_that_is_wanted_is_passed(found, done, kind, idle):
    watch = Watch(Marks(found), Care(checkpoint_s=None))
    watch.begin(0.0)
    watch.after = kind
    ahead = [m.index for m in found if m.kind is kind and m.index > done + (not idle)]
    stop = watch.next_stop(1.0, done, idle, 99)
    assert stop == min([*ahead, 99])
    expected = DueTask.RELOAD if kind is MarkKind.RELOAD else DueTask.PAUSE
    assert (watch.due(1.0, stop) is expected) == (stop != 99)
