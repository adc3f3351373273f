"""A print as it is held at a look: what is judged, mended again, and not seen."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import cv2
import numpy as np
import pytest

from printctl.inspection import (
    Appearance,
    Gap,
    LayerFindings,
    Stations,
    Unseen,
    see_layer,
)
from printctl.machine.job.job import Insert, parse_job
from printctl.machine.job.marks import Marks
from printctl.observe.deciding import Decider, DecisionKind, Limits
from printctl.observe.devices import DeviceError
from printctl.observe.inspection_state import InspectionState
from printctl.observe.looks.expected_ink import (
    MendedStretch,
    count_tries,
    expected_ink,
    inspected_ink,
    is_mended,
    last_mends,
    layer_slab,
    unseen_words,
)
from printctl.observe.looks.look_context import LookContext, unseen_stretches
from printctl.observe.looks.look_evidence import build_evidence, keep_mends_only
from printctl.observe.looks.views import frame_holds
from printctl.observe.mending import Gap as MendGap
from printctl.observe.mending import HeldPrint, plan_mend
from printctl.observe.observed_job import ObservedJob, _keep_mended_gaps
from tests.printctl.observe.mending.small_jobs import (
    INK,
    NEEDLE,
    PRINTER,
    SYRINGE,
    bath_job,
)
from tests.registration.devices.camera_frame import scene


def stations_of(along, seen, why=None):
    """Stations each 0.1 mm of one stroke along x."""
    count = len(along)
    one, whole = np.ones(count), np.zeros(count, dtype=np.int64)
    at = np.column_stack([along, 0 * along])
    return Stations(
        at_mm=at, z_mm=0 * one, normal=at, piece=whole, stroke=whole, along_mm=along,
        length_mm=0.1 * one, expected_mm=one, width_mm=one, u_width_mm=one, offset_mm=one,
        present=one, seen=seen, why=whole if why is None else why,
    )  # fmt: skip


@pytest.mark.parametrize("kind", ["camera", "folder", "command"])
@pytest.mark.parametrize("shape", [(20, 20, 3), (5, 6, 7)])
def test_a_device_that_gives_the_same_twice_hangs(kind: str, shape: tuple[int, ...]) -> None:
    first, second = np.random.default_rng(1).integers(0, 255, (2, *shape), dtype=np.uint8)
    order = SimpleNamespace(device=SimpleNamespace(kind=kind))
    job = ObservedJob(Path(), cast(Any, order))
    job._check_new(first, None)
    job._check_new(second, first)
    with pytest.raises(DeviceError, match="gave the last picture once more"):
        job._check_new(second.copy(), None)
    with pytest.raises(DeviceError, match="gave the last picture once more"):
        job._check_new(first, first.copy())


def test_the_slab_of_filaments_holds_where_they_begin() -> None:
    """A piece that led upwards was looked for above its own end alone: its ink was a gap."""
    ink = SimpleNamespace(
        layered=False,
        start=np.array([[0.0, 0, 2.0], [3.0, 0, 5.0]]),
        end=np.array([[3.0, 0, 5.0], [6.0, 0, 7.0]]),
        height_mm=np.array([0.4, 0.8]),
    )
    layer = SimpleNamespace(fresh_row=np.arange(2))
    middle, thick = layer_slab(cast(Any, ink), cast(Any, layer))
    assert (middle - thick / 2, middle + thick / 2) == pytest.approx((1.8, 7.4))


# --- state that an observer learned from its looks, as another one that begins anew reads it
def test_an_observer_that_begins_anew_knows_what_the_last_look_had_learned() -> None:
    """The first look after a restart learned ink anew, and told nothing of a layer without ink."""
    look = Appearance(np.random.default_rng(1).normal(0.0, 1.0, (3, 5, 16, 2)))
    known = InspectionState(look, (0.02, 0.03), "200 × 100 pixels")
    found = InspectionState.from_state(json.loads(json.dumps(known.state())))
    assert (found.voxel_mm, found.size) == ((0.02, 0.03), "200 × 100 pixels")
    assert found.appearance is not None
    assert np.array_equal(found.appearance.profile, look.profile)
    assert InspectionState.from_state(None) == InspectionState()


# --- whether an earlier picture was taken where a camera's frame holds
def test_an_earlier_picture_holds_only_in_the_frame_that_was_fitted_where_it_was_taken() -> None:
    """A camera that was bumped and fitted anew has moved since the picture before."""
    frame = scene.frame()
    assert frame_holds(scene.shifted(0.0, 0.0), frame)
    assert not frame_holds(scene.shifted(0.2, 0.0), frame)
    assert not frame_holds(None, frame)
    assert not frame_holds(scene.shifted(0.0, 0.0), object())
    assert not frame_holds(np.zeros((400, 400), np.uint8), frame)


def bath_print(gap):
    """A bath's two filaments, of which a gap of the first was mended behind both."""
    text = bath_job([(100, 100, 5), (106, 100, 5)], [(100, 104, 6), (106, 104, 6)])
    job = parse_job("\n".join([*text.lines, "M400"]).encode(), "small", PRINTER)
    done = job.marks.all[1].index
    held = HeldPrint(job.lines, done, PRINTER, SYRINGE, INK, NEEDLE, "embedded")
    return job.grown(Insert(1, held.done, plan_mend(held, [MendGap(0, *gap)]).lines))


@pytest.mark.parametrize("missing", [True, False])
def test_a_short_mend_that_failed_is_seen(missing):
    """Sound ink's round ends covered a gap of 0.4 mm: it stayed silent."""
    grown = bath_print((2.0, 2.4))
    held = HeldPrint(grown.lines, len(grown), PRINTER, SYRINGE, INK, NEEDLE, "embedded")
    ink = expected_ink(held, grown)
    mended = [MendedStretch(0, 2.0, 2.4)]
    again = inspected_ink(ink, 0, held.done)
    picture, frame = picture_of(ink, (2.0, 2.4) if missing else None)
    findings = see_layer(picture, frame, again.lines)
    gaps = _keep_mended_gaps(findings, tuple(mended)).gaps
    assert [(one.stroke, one.from_mm, one.to_mm) for one in gaps] == [
        (0, pytest.approx(2.0, abs=0.12), pytest.approx(2.4, abs=0.12))
    ] * missing
    assert unseen_words(findings.stations, mended) == ""


def test_a_mend_that_failed_is_mended_again_unasked_unless_a_third_of_all_is_missing():
    """The mend counted as missing, and not as written: of 3.8 of 12 mm it was said 46 %."""
    gap = (1.0, 4.8)
    grown = bath_print(gap)
    held = HeldPrint(grown.lines, len(grown), PRINTER, SYRINGE, INK, NEEDLE, "embedded")
    ink = expected_ink(held, grown)
    again = inspected_ink(ink, 0, held.done)
    picture, frame = picture_of(ink, gap)
    findings = see_layer(picture, frame, again.lines)
    evidence = build_evidence(
        again, ink, findings, findings, section=held.ink.bead_section, least_gap_mm=0.2,
        left_ul=None,
    )  # fmt: skip
    assert evidence.way_mm == pytest.approx(12.0, abs=0.5)
    assert Decider(Limits(mend="mend")).decide(keep_mends_only(evidence)).kind is DecisionKind.MEND


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
    assert last_mends(found) == ((MendedStretch(**mended),), 10)
    assert last_mends(None) == ((), 0)


def gap_on(stroke, low, high):
    return Gap(stroke, low, high, (low, 0.0), (high, 0.0), 0.01, 1e-9)


def test_gaps_are_of_a_mend_where_half_of_one_lies_in_the_other():
    """What was left bare on purpose beside a mend isn't a mend that failed."""
    mended = (MendedStretch(0, 1.0, 2.6), MendedStretch(0, 3.4, 5.0))
    assert is_mended(gap_on(0, 1.5, 1.9), mended)
    assert is_mended(gap_on(0, 1.0, 5.0), mended)
    assert not is_mended(gap_on(0, 2.5, 3.5), mended)
    assert not is_mended(gap_on(1, 1.5, 1.9), mended)


def test_mends_are_no_lines_of_their_own():
    grown = bath_print((2.0, 4.0))
    held = HeldPrint(grown.lines, len(grown), PRINTER, SYRINGE, INK, NEEDLE, "embedded")
    ink = expected_ink(held, grown)
    assert ink.inserted.any()
    layer = inspected_ink(ink, 0, held.done)
    assert not ink.inserted[layer.row].any()
    assert layer.lines.fresh.all()


def test_tries_are_counted_where_gaps_overlap():
    mended = (MendedStretch(3, 2.0, 4.0, 2),)
    assert count_tries(MendGap(3, 3.5, 5.0), mended) == 2
    assert count_tries(MendGap(3, 4.0, 5.0), mended) == 0
    assert count_tries(MendGap(4, 2.0, 4.0), mended) == 0


@pytest.mark.parametrize(("sees", "told"), [(False, [(1.0, 1.8)]), (True, [])])
def test_a_stretch_that_no_picture_sees_is_told_by_its_length(sees, told):
    along = np.arange(0.05, 4.0, 0.1)
    hidden = (along > 1.0) & (along < 1.8) | (along > 2.5) & (along < 2.6)
    crossed = (along > 3.0) & (along < 3.6)

    def picture(seen):
        why = np.where(crossed, int(Unseen.COVERED), np.where(seen, 0, int(Unseen.GLARE)))
        return SimpleNamespace(stations=stations_of(along, seen & ~crossed, why))

    path = SimpleNamespace(length_mm=4.0, command=np.array([0]))
    at = SimpleNamespace(ink=SimpleNamespace(paths=(path,)), marks=Marks([]), mended=())
    each = [picture(~hidden), picture(np.full(len(along), sees))]
    found = unseen_stretches(cast(LookContext, at), cast(list[LayerFindings], each), 0.2)
    assert [(round(one.gap.from_mm, 6), round(one.gap.to_mm, 6)) for one in found] == told
