"""Mends of layered prints."""

from dataclasses import replace

import numpy as np
import pytest

from design.toolpath.priming import Purge
from printctl.machine.link.insert_check import InsertPlace, judged_lines
from printctl.machine.link.job_reach import JobReach
from printctl.observe.mending import (
    Gap,
    MendError,
    MendOptions,
    Voids,
    check_mend,
    checked_mend,
    gap_between,
    plan_mend,
    written_paths,
)
from tests.printctl.observe.mending.small_jobs import (
    LAYER_MM,
    WIDTH_MM,
    JobText,
    layered_job,
    line_area_mm2,
)


@pytest.fixture(scope="module")
def held():
    return layered_job().held()


def last(held):
    return len(written_paths(held)) - 1


def tube(a, b, radius):
    return Voids(np.array([a], float), np.array([b], float), np.full((1, 2), radius))


def test_a_gap_is_written_again_as_the_job_wrote_it_and_ends_where_the_print_is_held(held):
    path = written_paths(held)[-1]
    gap = Gap(path.number, 7.0, 9.5)  # round a corner
    mend = plan_mend(held, [gap])
    (patch,) = mend.patches
    points, _, feed = patch.moves()
    assert np.allclose(points[1:3], path.points[1:3], atol=1e-9)  # both corners are kept
    assert set(feed) == {10.0}
    assert patch.before_mm == pytest.approx(WIDTH_MM, abs=0.15)
    assert patch.beyond_mm == pytest.approx(WIDTH_MM, abs=0.15)
    checked = check_mend(held, mend.lines, [gap])
    assert checked.passed
    assert checked.covered == 1.0
    assert checked.outside_mm < 0.01
    assert checked.duration_s == pytest.approx(mend.duration_s)
    length = patch.to_mm - patch.from_mm
    assert mend.volume_ul == pytest.approx(length * path.e_per_mm[0] * held.ul_per_e, rel=0.2)


def test_the_link_takes_the_insert(held):
    mend = plan_mend(held, [Gap(last(held), 1.0, 2.0)])
    place = InsertPlace(held.place, JobReach.of(held.lines, held.start_mm), held.printer)
    assert judged_lines([line.decode() for line in mend.lines], place, "insert") == mend.lines


def test_the_needle_travels_above_the_layer_and_comes_down_straight(held):
    mend = plan_mend(held, [Gap(last(held), 1.0, 2.0), Gap(last(held), 20.0, 21.0)])
    top, z = 5.0 + 3 * LAYER_MM, None
    for line in mend.lines:
        words = {word[:1]: float(word[1:]) for word in line.decode().split()[1:]}
        aside = {"X", "Y"} & words.keys()
        if line.startswith(b"G0") and aside:
            assert z is not None
            assert z >= top + 2 * LAYER_MM - 1e-9
            assert "Z" not in words
        z = words.get("Z", z)


def test_near_gaps_are_one_patch_and_far_ones_two(held):
    near = plan_mend(held, [Gap(last(held), 1.0, 1.4), Gap(last(held), 1.9, 2.4)])
    far = plan_mend(held, [Gap(last(held), 1.0, 1.4), Gap(last(held), 3.0, 3.4)])
    assert (len(near.patches), len(far.patches)) == (1, 2)


def test_a_whole_stroke_has_no_overlap(held):
    path = written_paths(held)[-1]
    (patch,) = plan_mend(held, [Gap(path.number, 0.0, path.length_mm)]).patches
    assert (patch.before_mm, patch.beyond_mm) == (0.0, 0.0)


def test_ink_of_a_later_layer_is_never_gone_through(held):
    under = [one.number for one in written_paths(held) if one.points[0, 2] < 5.5]
    mend = plan_mend(held, [Gap(number, 1.0, 2.0) for number in under])
    assert not mend.lines
    assert all("later layer" in one.reason for one in mend.left)
    assert sum(one.length_mm for one in mend.left) == pytest.approx(len(under))


def test_a_wipe_stops_where_a_later_layer_begins():
    job = layered_job(2)
    z = 5 + 3 * LAYER_MM
    job.stroke([(104, 100, z), (104, 102.5, z)], "LAYER_END:2")  # over the layer below
    held = job.held()
    lower = written_paths(held)[1]
    along, _ = lower.nearest_mm(np.array([103.0, 101.0, 5 + 2 * LAYER_MM]))
    for shift in np.arange(-1.0, 1.01, 0.1):
        gap = Gap(1, along + shift - 0.2, along + shift)
        mend = plan_mend(held, [gap])
        assert check_mend(held, mend.lines, [gap]).ink_crossed == 0


def test_a_lumen_is_never_entered_and_the_rest_of_the_gap_is_mended(held):
    path = written_paths(held)[-1]
    x, y, z = path.at(np.array([3.0]))[0]
    voids = tube((x, y, z - LAYER_MM / 2 - 1), (x, y, z - LAYER_MM / 2 + 1), 0.4)
    gap = Gap(path.number, 1.0, 5.0)
    mend = plan_mend(held, [gap], voids)
    assert len(mend.patches) == 2
    (left,) = mend.left
    assert "reach into a lumen" in left.reason
    checked = check_mend(held, mend.lines, [gap], voids)
    assert checked.passed
    assert checked.deepest_mm <= MendOptions().void_tolerance_mm
    assert left.length_mm == pytest.approx(2 * (0.4 + WIDTH_MM / 2 - 0.05), abs=0.3)


def test_a_check_sees_an_insert_through_a_lumen(held):
    gap = Gap(last(held), 1.0, 5.0)
    mend = plan_mend(held, [gap])
    x, y, z = written_paths(held)[-1].at(np.array([3.0]))[0]
    assert check_mend(held, mend.lines, [gap], tube((x, y, z - 1), (x, y, z), 0.4)).lumens_entered


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (lambda lines: [*lines, b"G0 X101"], "off_mm"),
        (lambda lines: [line for line in lines if not line.startswith(b"G92")], "off_mm"),
        (lambda lines: [*lines, b"M221 S110"], "refused"),
        (lambda lines: [*lines[:-1], b"G1 F77"], "same_modes"),
        (lambda lines: [b"G0 Z5.1", *lines], "ink_crossed"),
        (lambda lines: [*lines, b"G0 X900", b"G0 X100"], "beyond_limits"),
    ],
)
def test_a_check_sees_what_is_wrong(held, change, field):
    gap = Gap(last(held), 1.0, 2.0)
    mend = plan_mend(held, [gap])
    found = check_mend(held, change(list(mend.lines)), [gap])
    assert not found.passed
    assert bool(getattr(found, field)) is (field != "same_modes")


def test_a_mend_that_fails_its_check_has_no_lines(held, monkeypatch):
    gap = Gap(last(held), 1.0, 2.0)
    mend, check = checked_mend(held, [gap])
    assert mend.lines
    assert check.passed
    wrong = replace(check, lumens_entered=2)
    monkeypatch.setattr("printctl.observe.mending.plan.check_mend", lambda *args, **more: wrong)
    mend, check = checked_mend(held, [gap])
    assert (mend.lines, mend.patches) == ((), ())
    assert "2 pieces of ink in lumens" in mend.left[0].reason


def test_a_thin_stretch_is_filled_up_where_the_line_stands_as_high_as_its_layer(held):
    path = written_paths(held)[-1]
    gap = Gap(path.number, 1.0, 3.0, 0.25)
    mend = plan_mend(held, [gap])
    (patch,) = mend.patches
    assert (patch.from_mm, patch.to_mm) == (1.0, 3.0), "nothing comes upon sound ink"
    missing = 0.25 * 2.0 * path.e_per_mm[0] * held.ul_per_e
    assert mend.volume_ul == pytest.approx(missing, rel=0.15)
    assert check_mend(held, mend.lines, [gap]).passed
    lumen = tube([102.0, 100.0 - 0.35, 0], [102.0, 100.0 - 0.35, 20], 0.3)
    beside = plan_mend(held, [replace(gap, from_mm=0.1)], lumen)
    assert beside.left
    assert all("lumen" in one.reason for one in beside.left)


def test_thin_stretches_are_joined_with_their_mean(held):
    number = last(held)
    thin = [Gap(number, 1.0, 2.0, 0.2), Gap(number, 2.2, 3.2, 0.3)]
    (patch,) = plan_mend(held, thin).patches
    assert (patch.from_mm, patch.to_mm) == (1.0, 3.2)
    assert patch.flow == pytest.approx(0.25, rel=0.15)


def test_a_thin_stretch_that_may_be_low_is_written_over_only_where_height_allows(held):
    thin = {"missing": 0.4}
    unknown = plan_mend(held, [Gap(last(held), 1.0, 3.0, **thin)])
    full = plan_mend(held, [Gap(last(held), 1.0, 3.0, seen_height_mm=LAYER_MM, **thin)])
    low = plan_mend(held, [Gap(last(held), 1.0, 3.0, seen_height_mm=0.6 * LAYER_MM, **thin)])
    assert "may stand lower" in unknown.left[0].reason
    assert "correct the flow" in full.left[0].reason
    assert low.patches[0].flow == pytest.approx(0.4, rel=0.1)


def test_a_short_patch_is_whole_steps_of_the_plunger(held):
    (patch,) = plan_mend(held, [Gap(last(held), 1.0, 1.2)]).patches
    steps = patch.moves()[1].sum() * held.printer.steps_per_mm.e
    assert steps == pytest.approx(round(steps), abs=1e-6)


def test_a_flow_corrected_since_is_the_patches_too(held):
    plain, more = (
        plan_mend(held, [Gap(last(held), 1.0, 6.0, flow=flow)]).volume_ul for flow in (1.0, 1.25)
    )
    assert more == pytest.approx(1.25 * plain, rel=0.05)


def test_a_purge_place_primes_and_wipes_outside_the_part(held):
    purge = Purge(np.array([102.0, 90.0, 30.0]), 1.0, np.array([103.0, 90.0, 30.0]))
    gap = Gap(last(held), 1.0, 2.0)
    mend = plan_mend(held, [gap], options=MendOptions(purge=purge))
    assert any(b"Y90" in line for line in mend.lines)
    assert mend.volume_ul == pytest.approx(1.0, abs=0.5)
    assert check_mend(held, mend.lines, [gap]).passed


def test_a_print_held_within_a_stroke_goes_on_with_its_plunger_as_it_was():
    whole = layered_job().held()
    path = written_paths(whole)[-1]
    held = replace(whole, done=int(path.command[6]) + 1)
    assert held.relieved_e == 0.0
    gap = Gap(path.number, 1.0, 2.0)
    mend = plan_mend(held, [gap])
    assert mend.lines[0].startswith(b"G1 E")  # relieved before it leaves
    assert mend.lines[-3].startswith(b"G1 E")  # and primed where it goes on
    assert check_mend(held, mend.lines, [gap]).passed


@pytest.mark.parametrize("wipe_mm", [np.array([93.0, 90.0, 28.0]), None])
def test_a_purge_before_a_mend_is_taken_by_the_link(wipe_mm):
    job = layered_job()
    job.lines[5:5] = ["G0 X90 Y90 F2400", "G0 Z28 F300", "G0 X93 Y90 F600", "G0 Z31 F300"]
    held = job.held()
    purge = Purge(np.array([90.0, 90.0, 28.0]), 1.0, wipe_mm)
    mend = plan_mend(held, [Gap(last(held), 1.0, 2.0)], options=MendOptions(purge=purge))
    assert check_mend(held, mend.lines, [Gap(last(held), 1.0, 2.0)]).passed
    place = InsertPlace(held.place, JobReach.of(held.lines, held.start_mm), held.printer)
    assert judged_lines([line.decode() for line in mend.lines], place, "insert") == mend.lines


def test_a_gap_between_two_places_is_found_on_its_path(held):
    paths = written_paths(held)
    places = paths[-1].at(np.array([9.0, 11.0])) + 0.02
    gap = gap_between(paths, places)
    assert gap.path == paths[-1].number
    assert (gap.from_mm, gap.to_mm) == pytest.approx((9.0, 11.0), abs=0.05)
    with pytest.raises(MendError, match="beside the nearest written path"):
        gap_between(paths, [(50, 50, 5), (51, 50, 5)])


@pytest.mark.parametrize(("low", "high"), [(0.0, 8.0), (5.0, 8.0), (0.0, 3.0), (1.0, 3.0)])
def test_a_closed_path_has_gaps_on_either_side_of_its_begin(low, high):
    job = layered_job(2)
    z = 5 + 3 * LAYER_MM
    square = [(100, 100, z), (102, 100, z), (102, 102, z), (100, 102, z), (100, 100, z)]
    job.stroke(square, "LAYER_END:2")
    path = written_paths(job.held())[-1]
    gap = gap_between([path], path.at(np.linspace(low, high, 5)))
    assert (gap.from_mm, gap.to_mm) == pytest.approx((low, high), abs=1e-6)


@pytest.mark.parametrize("gap", [Gap(99, 0, 1), Gap(0, 1, 1), Gap(0, 0, 1e3), Gap(0, 0, 1, -1.0)])
def test_gaps_that_cannot_be_are_refused(held, gap):
    with pytest.raises(MendError):
        plan_mend(held, [gap])


@pytest.mark.parametrize("at_end", [False, True])
def test_a_gap_at_the_end_of_a_finely_cut_stroke_is_written_to_that_end(at_end):
    job = JobText(line_area_mm2())
    turn = np.linspace(0, 1.9 * np.pi, 200)  # pieces of 0.06 mm
    for layer in range(2):
        z = np.full(len(turn), 5 + LAYER_MM * (layer + 1))
        job.stroke(
            np.column_stack([100 + 2 * np.cos(turn), 100 + 2 * np.sin(turn), z]), "LAYER_END"
        )
    held = job.held()
    path = written_paths(held)[-1]
    gap = Gap(path.number, 0.0, 0.3)
    if at_end:
        gap = replace(gap, from_mm=path.length_mm - 0.3, to_mm=path.length_mm)
    mend = plan_mend(held, [gap])
    (patch,) = mend.patches
    points, _, _ = patch.moves()
    assert np.allclose(points[-1 if at_end else 0], path.points[-1 if at_end else 0])
    assert check_mend(held, mend.lines, [gap]).covered == 1.0
    stated, sound = (patch.before_mm, 0) if at_end else (patch.beyond_mm, -1)
    edge = gap.from_mm if at_end else gap.to_mm
    assert abs(path.nearest_mm(points[sound])[0] - edge) == pytest.approx(stated, abs=1e-6)


@pytest.mark.parametrize("away_mm", [0.0, 0.02, 0.06])
def test_ink_on_sound_ink_beside_a_lumen_is_counted_as_wide_as_it_gets(away_mm):
    """What a second line adds can only go to the sides (section over layer height)."""
    held = layered_job().held()
    path = written_paths(held)[-1]
    x, y, z = path.at(np.array([3.0]))[0]  # on the first line, along Y or X
    ahead = path.at(np.array([4.0]))[0] - path.at(np.array([3.0]))[0]
    aside = np.array([-ahead[1], ahead[0], 0.0])
    radius = 0.5
    axis = np.array([x, y, z - LAYER_MM / 2]) + aside * (WIDTH_MM / 2 + away_mm + radius)
    voids = tube(axis - 2 * ahead, axis + 2 * ahead, radius)
    gap = Gap(path.number, 2.5, 3.5)
    mend = plan_mend(held, [gap], voids)
    (patch,) = mend.patches
    lies = held.ink.bead_section
    points, e, _ = patch.moves()
    section = e.sum() * held.ul_per_e / np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    overlaps = max(patch.before_mm, patch.beyond_mm) > 0
    both = section + (lies.area(WIDTH_MM, LAYER_MM) if overlaps else 0.0)
    reach = float(lies.width(both, LAYER_MM)) / 2 - WIDTH_MM / 2 - away_mm
    assert reach <= MendOptions().void_tolerance_mm + 1e-3
    assert check_mend(held, mend.lines, [gap], voids).passed


def test_a_check_counts_the_sound_ink_that_an_insert_is_written_onto(held):
    path = written_paths(held)[-1]
    x, y, z = path.at(np.array([3.0]))[0]
    ahead = path.at(np.array([4.0]))[0] - path.at(np.array([3.0]))[0]
    beside = np.array([-ahead[1], ahead[0], 0.0]) * (WIDTH_MM / 2 + 0.52)
    axis = np.array([x, y, z - LAYER_MM / 2]) + beside
    voids = tube(axis - 2 * ahead, axis + 2 * ahead, 0.5)
    gap = Gap(path.number, 2.8, 3.2)
    insert = plan_mend(held, [gap]).lines
    assert not check_mend(held, insert, [Gap(path.number, 2.0, 4.0)], voids).lumens_entered
    assert check_mend(held, insert, [gap], voids).lumens_entered


def test_sound_ink_between_near_gaps_beside_a_lumen_is_left_alone(held):
    path = written_paths(held)[-1]
    x, y, z = path.at(np.array([3.0]))[0]
    ahead = path.at(np.array([4.0]))[0] - path.at(np.array([3.0]))[0]
    beside = np.array([-ahead[1], ahead[0], 0.0]) * (WIDTH_MM / 2 + 0.52)
    axis = np.array([x, y, z - LAYER_MM / 2]) + beside
    voids = tube(axis - 2 * ahead, axis + 2 * ahead, 0.5)
    gaps = [Gap(path.number, 2.2, 2.8), Gap(path.number, 3.0, 3.6)]
    mend = plan_mend(held, gaps, voids)
    assert len(mend.patches) == 2
    checked = check_mend(held, mend.lines, gaps, voids)
    assert checked.passed
    assert checked.covered == 1.0


def test_a_job_of_one_layer_is_mended_as_round_lines():
    one = layered_job(layers=1).held()
    path = written_paths(one)[0]
    assert path.height_mm == pytest.approx(np.sqrt(4 / np.pi * line_area_mm2()), rel=1e-3)
    mend = plan_mend(one, [Gap(0, 2.0, 4.0)])
    assert mend.lines
    assert check_mend(one, mend.lines, [Gap(0, 2.0, 4.0)]).passed


@pytest.mark.parametrize("corner", [2.7636130336933916, 1.1, 0.3])
def test_a_corner_just_far_enough_from_an_end_is_kept(corner):
    path = written_paths(layered_job(layers=1).held())[0]
    bent = replace(path, points=np.array([[0, 0, 5], [corner, 0, 5], [corner, 2, 5]], float))
    _, end = bent.clear_of_corners(0.0, corner + 0.03)
    assert corner in bent.cuts(0.0, end, 0.1)
