"""Mended gaps are looked at again in place of the lines that mended them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from printctl.machine.link.inserts import Insert
from printctl.machine.link.job import parse_job
from printctl.observe.deciding import Decider, DecisionKind, Limits
from printctl.observe.expected import expected_ink
from printctl.observe.judging import evidence_of, ink_to_judge, without_rest
from printctl.observe.look_values import Look
from printctl.observe.mending import Gap as MendGap
from printctl.observe.mending import HeldPrint, plan_mend
from printctl.observe.mends_again import (
    Mended,
    gaps_of_job,
    last_mends,
    of_mends,
    unseen_words,
    with_mends,
)
from printctl.observe.records import LookRecord
from registration.inspection import see_layer
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


def bath_print(gap):
    """A bath's two filaments, of which a gap of the first was mended behind both."""
    text = bath_job([(100, 100, 5), (106, 100, 5)], [(100, 104, 6), (106, 104, 6)])
    job = parse_job("\n".join([*text.lines, "M400"]).encode(), "small", PRINTER)
    done = job.marks.all[1].index
    held = HeldPrint(job.lines, done, PRINTER, SYRINGE, INK, NEEDLE, "embedded")
    return job.grown(Insert(1, held.done, plan_mend(held, [MendGap(0, *gap)]).lines)), done


@pytest.mark.parametrize("missing", [True, False])
def test_a_short_mend_that_failed_is_seen(missing):
    """Sound ink's round ends covered a gap of 0.4 mm: it stayed silent."""
    grown, done = bath_print((2.0, 2.4))
    held = HeldPrint(grown.lines, len(grown), PRINTER, SYRINGE, INK, NEEDLE, "embedded")
    ink = expected_ink(held, grown)
    mended = [Mended(0, 2.0, 2.4)]
    again = with_mends(ink_to_judge(ink, 0, held.done), ink, mended, done)
    picture, frame = picture_of(ink, (2.0, 2.4) if missing else None)
    findings = see_layer(picture, frame, again.lines)
    gaps = gaps_of_job(of_mends(findings).gaps, again.mended)
    assert [(one.stroke, one.from_mm, one.to_mm) for one in gaps] == [
        (0, pytest.approx(2.0, abs=0.12), pytest.approx(2.4, abs=0.12))
    ] * missing
    assert unseen_words(findings, again.mended) == ""


def test_a_mend_that_failed_is_mended_again_unasked_unless_a_third_of_all_is_missing():
    """The mend counted as missing, and not as written: of 3.8 of 12 mm it was said 46 %."""
    gap = (1.0, 4.8)
    grown, done = bath_print(gap)
    held = HeldPrint(grown.lines, len(grown), PRINTER, SYRINGE, INK, NEEDLE, "embedded")
    ink = expected_ink(held, grown)
    again = with_mends(ink_to_judge(ink, 0, held.done), ink, [Mended(0, *gap)], done)
    picture, frame = picture_of(ink, gap)
    findings = see_layer(picture, frame, again.lines)
    evidence = evidence_of(
        again, ink, findings, findings, section=held.ink.bead_section, least_gap_mm=0.2,
        left_ul=None,
    )  # fmt: skip
    assert evidence.way_mm == pytest.approx(12.0, abs=0.5)
    assert Decider(Limits(mend="mend")).decide(without_rest(evidence)).kind is DecisionKind.MEND


@dataclass(frozen=True)
class Above:
    """A camera straight above, 40 pixels in a mm."""

    def to_pixels(self, points_mm):
        return 40.0 * (np.asarray(points_mm)[:, :2] - (98.0, 98.0))


def picture_of(ink, bare):
    """Dark filaments in a light bath with noise, the first one without a stretch."""
    rng, shape = np.random.default_rng(3), (320, 400)
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]] / 40.0 + 98.0
    dark = np.zeros(shape)
    for stroke, row in ((0, 100.0), (1, 104.0)):
        radius = ink.width_mm[ink.stroke == stroke].max() / 2
        spans = [(100.0, 106.0)]
        if stroke == 0 and bare:
            spans = [(100.0, 100.0 + bare[0] - radius), (100.0 + bare[1] + radius, 106.0)]
        for low, high in spans:
            off = np.hypot(x - np.clip(x, low, high), y - row)
            dark = np.maximum(dark, np.sqrt(np.clip(1 - (off / radius) ** 2, 0, None)))
    light = 150.0 * np.exp(-0.5 * cv2.GaussianBlur(dark, (0, 0), 1.0))
    return np.clip(light + rng.normal(0, 2.0, shape), 0, 255).astype(np.uint8), Above()


def test_what_was_mended_is_known_by_the_last_look_that_was_judged():
    mended = {"path": 3, "from_mm": 2.0, "to_mm": 2.4, "tries": 1}
    found = {"seen_share": 1.0, "mended": [mended], "about_from": 10}
    looks = [
        LookRecord(1, 20, 20, "", 0.0, "mend", "", found=found),
        LookRecord(2, 60, 40, "", 0.0, "pause", "the camera hangs"),
    ]
    again = Look(3, 60, 40, 20, "end of what was inserted")
    assert last_mends(looks, again) == ((Mended(**mended),), 10)
    assert last_mends([], again) == ((), 0)


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
