"""Mended gaps are looked at again in place of the lines that mended them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from printctl.link.inserts import Insert
from printctl.link.job import parse_job
from printctl.link.marks import Marks
from printctl.observe.expected import expected_ink
from printctl.observe.held_look import unseen_paths
from printctl.observe.judging import ink_to_judge
from printctl.observe.mending import Gap as MendGap
from printctl.observe.mending import HeldPrint, plan_mend
from printctl.observe.mends_again import Mended, gaps_of_job, tries_of, with_mends
from registration.layer_images import Gap
from tests.printctl.observe.mending.small_jobs import (
    INK,
    LAYER_MM,
    NEEDLE,
    PRINTER,
    SYRINGE,
    JobText,
    bath_job,
    line_area_mm2,
)

LINES = 6


def print_of(layers=2):
    """Layers of spaced lines of 8 mm; a line's end each."""
    job = JobText(line_area_mm2())
    for layer in range(layers):
        z = 5.0 + LAYER_MM * (layer + 1)
        for k in range(LINES):
            ends = np.array([[0, k, z], [8, k, z]]) if layer % 2 == 0 else None
            ends = np.array([[k, 0, z], [k, 8, z]]) if ends is None else ends
            job.stroke(ends + [100, 100, 0], mark=f"PASS_END:{k}")
    return parse_job("\n".join([*job.lines, "M400"]).encode(), "small", PRINTER)


def held_at(job, mark):
    done = job.marks.all[mark].index
    return HeldPrint(job.lines, done, PRINTER, SYRINGE, INK, NEEDLE, "layered")


def mended_print(low=2.0, high=4.0):
    """The job with a gap of its fourth line mended, and the command it was held at."""
    job = print_of()
    held = held_at(job, 3)
    mend = plan_mend(held, [MendGap(3, low, high)])
    return job.grown(Insert(1, held.done, mend.lines)), held.done


def looked(mark, low=2.0, high=4.0):
    job, before = mended_print(low, high)
    held = held_at(job, mark)
    ink = expected_ink(held, job)
    layer = ink_to_judge(ink, before, held.done)
    return ink, layer, with_mends(layer, ink, [Mended(3, low, high)], before)


@pytest.mark.parametrize("mark", [5, 6])
def test_the_gap_alone_is_fresh_and_its_mend_is_left_out(mark):
    ink, layer, again = looked(mark)
    lines = again.lines
    assert not ink.inserted[again.row].any()
    (row,) = np.flatnonzero(lines.stroke >= 1_000_000)
    assert lines.fresh[row]
    assert lines.start[row, :2] == pytest.approx([102, 103])
    assert lines.end[row, :2] == pytest.approx([104, 103])
    rest = lines.stroke == 3
    assert not lines.fresh[rest].any()
    assert np.linalg.norm(lines.end - lines.start, axis=1)[rest].sum() == pytest.approx(6.0)
    assert lines.fresh.sum() == layer.lines.fresh.sum() + 1


def test_what_a_later_layer_covers_isnt_looked_at_again():
    _, layer, again = looked(10)
    assert again is layer


def test_a_gap_in_a_mend_is_the_paths_own():
    mended = (Mended(3, 2.0, 4.0),)
    gap = Gap(1_000_000, 0.5, 3.0, (0, 0), (0, 0), 0.01, 1e-9)
    (found,) = gaps_of_job([gap], mended)
    assert (found.stroke, found.from_mm, found.to_mm) == (3, 2.5, 4.0)
    other = replace(gap, stroke=5)
    assert gaps_of_job([other], mended) == (other,)


def test_tries_are_counted_where_gaps_overlap():
    mended = (Mended(3, 2.0, 4.0, 2),)
    assert tries_of(MendGap(3, 3.5, 5.0), mended) == 2
    assert tries_of(MendGap(3, 4.0, 5.0), mended) == 0
    assert tries_of(MendGap(4, 2.0, 4.0), mended) == 0


def test_a_mend_in_a_bath_is_looked_at_again():
    """A clog that lasted into the mend of a vessel was never told."""
    text = bath_job([(100, 100, 5), (106, 100, 5)], [(100, 104, 6), (106, 104, 6)])
    job = parse_job("\n".join([*text.lines, "M400"]).encode(), "small", PRINTER)
    done = job.marks.all[0].index
    held = HeldPrint(job.lines, done, PRINTER, SYRINGE, INK, NEEDLE, "embedded")
    mend = plan_mend(held, [MendGap(0, 2.0, 4.0)])
    grown = job.grown(Insert(1, held.done, mend.lines))
    whole = HeldPrint(grown.lines, len(grown), PRINTER, SYRINGE, INK, NEEDLE, "embedded")
    ink = expected_ink(whole, grown)
    layer = ink_to_judge(ink, held.done, whole.done)
    again = with_mends(layer, ink, [Mended(0, 2.0, 4.0)], held.done)
    lines, row = again.lines, again.lines.stroke >= 1_000_000
    assert lines.fresh[row].all()
    assert lines.start[row][0, :2] == pytest.approx([102, 100])
    assert lines.end[row][-1, :2] == pytest.approx([104, 100])
    assert lines.fresh.sum() == layer.lines.fresh.sum() + row.sum()
    assert not ink.inserted[again.row].any()


def test_a_mend_of_which_nothing_is_seen_is_asked_about_by_its_vessel():
    path = SimpleNamespace(
        at=lambda along: np.column_stack([along, 0 * along, 0 * along]),
        length_mm=7.0, command=np.array([0]),
    )  # fmt: skip
    layer = SimpleNamespace(mended=(Mended(0, 2.0, 5.0),))
    at = SimpleNamespace(ink=SimpleNamespace(paths=(path,)), marks=Marks([]), layer=layer)
    faint = Gap(1_000_000, 0.0, 3.0, (2, 0), (5, 0), 0.0, 1.0)
    seen = SimpleNamespace(bare=(1_000_000,), gaps=(), unseen=(faint,), stations=None)
    (told,) = unseen_paths(at, [seen], 1.5)
    assert told.words == "the mend in path 0 (3.0 mm)"
    assert (told.gap.stroke, told.gap.from_mm, told.gap.to_mm) == (0, 2.0, 5.0)
    assert unseen_paths(at, [SimpleNamespace(**{**vars(seen), "bare": ()})], 1.5) == ()
