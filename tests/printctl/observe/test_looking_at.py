"""A layer's shift is believed where its ink shows it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import cv2
import numpy as np
import pytest

from printctl.machine.job.job import Insert, parse_job
from printctl.machine.job.marks import Marks
from printctl.observe.deciding import Decider, DecisionKind, Limits
from printctl.observe.devices import DeviceError
from printctl.observe.expected import expected_ink
from printctl.observe.held_look import HeldLook, hidden_stretches, slab, unseen_paths
from printctl.observe.judging import evidence_of, ink_to_judge, shift_of, without_rest
from printctl.observe.learned import STATE, Learned
from printctl.observe.look_values import Look
from printctl.observe.looking_at import ObservedJob
from printctl.observe.mending import Gap as MendGap
from printctl.observe.mending import HeldPrint, plan_mend
from printctl.observe.mends_again import (
    Mended,
    gaps_of_job,
    last_mends,
    of_mends,
    tries_of,
    unseen_words,
    with_mends,
)
from printctl.observe.records import LookRecord
from printctl.observe.shown_place import seen_where_ink_shows
from printctl.observe.views import frame_holds
from registration.inspection import (
    Appearance,
    Gap,
    LayerFindings,
    SeeingOptions,
    Shift,
    Stations,
    Unseen,
    see_layer,
)
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
    rows, lines = np.arange(2), SimpleNamespace(fresh=np.ones(2, dtype=np.bool_))
    ink = SimpleNamespace(
        style="embedded",
        start=np.array([[0.0, 0, 2.0], [3.0, 0, 5.0]]),
        end=np.array([[3.0, 0, 5.0], [6.0, 0, 7.0]]),
        height_mm=np.array([0.4, 0.8]),
    )
    held = cast(Any, SimpleNamespace(ink=ink, layer=SimpleNamespace(row=rows, lines=lines)))
    middle, thick = slab(held)
    assert (middle - thick / 2, middle + thick / 2) == pytest.approx((1.8, 7.4))


def test_what_one_picture_does_not_tell_and_the_other_shows_as_a_gap_is_asked_about() -> None:
    def gap(begin: float, end: float) -> Gap:
        return Gap(0, begin, end, (begin, 0.0), (end, 0.0), 0.0, 1.0)

    along = np.arange(0.05, 7.0, 0.1)

    def picture(
        gaps: tuple[Gap, ...] = (), unseen: tuple[Gap, ...] = (), sees: bool = False
    ) -> SimpleNamespace:
        stations = stations_of(along, np.full(len(along), sees))
        return SimpleNamespace(bare=(), gaps=gaps, unseen=unseen, stations=stations)

    nothing, clear = picture(unseen=(gap(0, 7),)), picture(sees=True)
    faint, faint_gap = picture(), picture(gaps=(gap(4, 7),))
    clear_gap = picture(gaps=(gap(4, 7),), sees=True)
    doubted = picture(unseen=(gap(2, 6),), sees=True)
    path = SimpleNamespace(
        at=lambda along: np.column_stack([along, 0 * along, 0 * along]), length_mm=7.0,
        command=np.array([0]),
    )  # fmt: skip
    at = SimpleNamespace(
        ink=SimpleNamespace(paths=(path,)), marks=Marks([]), layer=SimpleNamespace(mended=())
    )
    for each, told in (
        ([nothing], [(0, 7)]),
        ([nothing, nothing], [(0, 7)]),
        ([nothing, faint], [(0, 7)]),
        ([nothing, faint_gap], [(0, 7)]),
        ([faint, nothing], [(0, 7)]),
        ([nothing, clear], []),
        ([nothing, clear_gap], [(4, 7)]),
        ([clear_gap, nothing], [(4, 7)]),
        ([clear_gap, clear_gap], []),
        ([clear, nothing], []),
        ([faint, faint_gap], [(4, 7)]),
        ([faint_gap, faint], [(4, 7)]),
        ([clear, faint_gap], []),
        ([doubted, doubted], [(2, 6)]),  # either was told by the other's ink
        ([doubted, clear], []),
    ):
        found = unseen_paths(cast(HeldLook, at), cast(list[LayerFindings], each), 1.5)
        assert [(one.gap.from_mm, one.gap.to_mm) for one in found] == told
    for scanned in (False, True):
        order = SimpleNamespace(oct=scanned, limits=SimpleNamespace(unseen_mm=1.5))
        bath = SimpleNamespace(
            ink=SimpleNamespace(paths=(path,), style="embedded"), marks=at.marks, layer=at.layer
        )
        seen = ObservedJob._unseen(
            cast(Any, SimpleNamespace(order=order)), cast(Any, bath), [nothing]
        )
        assert len(seen) == 1


# --- a layer whose ink lies aside as a whole is told as moved, and nothing of it as missing
@dataclass(frozen=True)
class Found:
    """What is found within one reach."""

    shift: Shift
    coverage: float
    seen_share: float = 1.0
    aside: bool = False
    ink_mm: float = 2.0
    gaps: tuple[int, ...] = ()
    normal: tuple[float, float] = (0.0, 1.0)
    unseen: int = 0
    first: int = 0

    @property
    def stations(self) -> SimpleNamespace:
        """Ten of 0.2 mm; the last one lacks what isn't there."""
        one = np.ones(10)
        shown = np.arange(10)
        present = np.append(one[1:], 1.0 - (2.0 - self.ink_mm) / 0.2)
        along = 0.2 * np.arange(10)
        return SimpleNamespace(
            stroke=0 * one, along_mm=along, length_mm=0.2 * one, present=present,
            seen=(shown < 10 - self.unseen) & (shown >= self.first),
            normal=np.tile(self.normal, (10, 1)),
            at_mm=np.column_stack([0 * along, along]),
        )  # fmt: skip


def looked(
    by_reach: dict[float, tuple[float, float, float]], lone: bool = True
) -> tuple[float, float, bool, list[float]]:
    """Move, its uncertainty, whether aside; of moves, uncertainties and coverages by reach."""
    asked = []

    def see(options: SeeingOptions) -> Found:
        asked.append(options.shift_mm)
        moved, u, coverage = by_reach[options.shift_mm]
        return Found(Shift(0.0, moved, u**2 * np.eye(2)), coverage)

    found = seen_where_ink_shows(cast(Any, see), SeeingOptions(shift_mm=0.5), 0.1, lone)
    return *shift_of(found), found.aside, asked


@pytest.mark.parametrize("within", [0.3, float("nan")])
def test_ink_that_lies_aside_as_a_whole_is_moved_however_unsure_by_how_much(within: float) -> None:
    reaches = {0.5: (0.3, 0.29, 0.98), 0.1: (0.0, 0.1, within), 1.0: (0, 0, 0)}
    moved, u, aside, asked = looked(reaches)
    assert (moved, u, aside) == (0.3, 0.29, True)
    assert asked[:2] == [0.5, 0.1]


@pytest.mark.parametrize(
    ("by_reach", "lone"),
    [
        ({0.5: (0.3, 0.29, 0.98), 0.1: (0.0, 0.1, 0.3)}, False),  # it may be the older layer
        ({0.5: (0.3, 0.29, 0.98), 0.1: (0.0, 0.1, 0.8)}, True),  # a lone line whose end is missing
        ({0.5: (0.0, 0.5, 0.1), 0.1: (0.0, 0.1, 0.2), 1.0: (0.7, 0.1, 0.4)}, True),  # a clog
    ],
)
def test_missing_ink_is_no_move(
    by_reach: dict[float, tuple[float, float, float]], lone: bool
) -> None:
    moved, _, aside, _ = looked(by_reach, lone)
    assert (moved, aside) == (0.0, False)


@pytest.mark.parametrize(
    ("gaps", "ink_mm", "aside"), [((), 1.8, True), ((1,), 1.8, False), ((), 1.99, False)]
)
def test_a_line_that_is_as_long_as_it_should_be_is_moved_along_itself(gaps, ink_mm, aside):
    """A vessel moved by 0.3 mm along itself went on; one that lacks an end has less ink."""

    def see(options: SeeingOptions) -> Found:
        if options.shift_mm < 0.5:
            return Found(Shift(0.0, 0.1, 0.01 * np.eye(2)), 0.93, ink_mm=ink_mm)
        return Found(Shift(0.0, 0.3, 0.01 * np.eye(2)), 0.98, gaps=gaps)

    found = seen_where_ink_shows(cast(Any, see), SeeingOptions(shift_mm=0.5), 0.1)
    assert found.aside is aside
    assert found.coverage == (0.98 if aside else 0.93)


# --- state that an observer learned from its looks, as another one that begins anew reads it
def test_an_observer_that_begins_anew_knows_what_the_last_look_had_learned() -> None:
    """The first look after a restart learned ink anew, and told nothing of a layer without ink."""
    look = Appearance(np.array([0.5, -1.0, 0.2]), np.ones((3, 61)), True, np.array([1.0, 2.0, 3.0]))
    known = Learned(look, (0.02, 0.03), "200 × 100 pixels")
    state = json.loads(json.dumps(known.state()))
    record = LookRecord(3, 10, 10, "end of layer 1", 1.0, "go_on", "", control={STATE: state})
    nothing = LookRecord(4, 20, 20, "end of layer 2", 2.0, "pause", "nothing seen: it hangs")
    found = Learned.before([record, nothing], 5)
    assert (found.voxel_mm, found.size) == ((0.02, 0.03), "200 × 100 pixels")
    assert found.appearance is not None
    for name in ("mix", "terms", "ink"):
        assert np.array_equal(getattr(found.appearance, name), getattr(look, name))
    assert Learned.before([record], 3) == Learned()


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


def test_tries_are_counted_where_gaps_overlap():
    mended = (Mended(3, 2.0, 4.0, 2),)
    assert tries_of(MendGap(3, 3.5, 5.0), mended) == 2
    assert tries_of(MendGap(3, 4.0, 5.0), mended) == 0
    assert tries_of(MendGap(4, 2.0, 4.0), mended) == 0


@pytest.mark.parametrize(
    ("sees", "gaps", "told"),
    [
        (False, (), [(1.0, 1.8)]),
        (True, (), []),
        (True, ((2.0, 2.95),), [(3.0, 3.6)]),  # over older ink, and a gap runs into it
        (True, ((2.0, 2.7),), []),
    ],
)
def test_a_stretch_that_no_picture_sees_is_told_by_its_length(sees, gaps, told):
    gaps = tuple(Gap(0, *one, (0.0, 0.0), (0.0, 0.0), 0.0, 0.0) for one in gaps)
    along = np.arange(0.05, 4.0, 0.1)
    hidden = (along > 1.0) & (along < 1.8) | (along > 2.5) & (along < 2.6)
    older = (along > 3.0) & (along < 3.6)

    def picture(seen):
        why = np.where(older, int(Unseen.OLD_INK), np.where(seen, 0, int(Unseen.GLARE)))
        return SimpleNamespace(stations=stations_of(along, seen, why), gaps=gaps)

    path = SimpleNamespace(
        at=lambda along: np.column_stack([along, 0 * along, 0 * along]), length_mm=4.0,
        command=np.array([0]),
    )  # fmt: skip
    at = SimpleNamespace(
        ink=SimpleNamespace(paths=(path,)), marks=Marks([]), layer=SimpleNamespace(mended=())
    )
    each = [picture(~(hidden | older)), picture(np.full(len(along), sees) & ~older)]
    found = hidden_stretches(cast(HeldLook, at), cast(list[LayerFindings], each), 0.2)
    assert [(round(one.gap.from_mm, 6), round(one.gap.to_mm, 6)) for one in found] == told
