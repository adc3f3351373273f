"""Shaft checker: planted collisions found, joints exempt, random jobs as by dense sampling."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcode.clearance.approach import SEARCH, shaft_distance
from gcode.clearance.check import check_clearance
from gcode.clearance.kernels import NeedleBody
from gcode.clearance.motion import LineSources, NeedleMotion, Pieces, heads_of, ink_of
from gcode.errors import ClearanceError
from tests.gcode.clearance.naive import STEP, nearest, signed
from tests.gcode.clearance.small_jobs import (
    HIGH,
    NEEDLE,
    RADIUS,
    START,
    Job,
    apart_of,
    approach_of,
    network,
)
from tests.slower import examples

R = NEEDLE.radius_mm
BAR = [(95, 100, 7), (105, 100, 7)]
"""A straight vessel along x, 7 mm up."""


def under(points, **kwargs):
    """The bar, and then a vessel written below it; returns the result and the last line."""
    job = Job()
    job.along(BAR, 0)
    line = job.along(points, 1)[-1]
    return job.check(network(BAR, points), **kwargs), line


def test_writing_under_a_filament_drives_the_shaft_through_it():
    found, line = under([(100, 97, 5), (100, 103, 5)])
    (crossing,) = found.crossings
    assert (crossing.line, crossing.kind, crossing.vessel, crossing.crossed) == (
        line,
        "write",
        1,
        0,
    )
    assert crossing.crossed_line == 7
    assert crossing.depth_mm == pytest.approx(R + RADIUS, abs=0.003)
    np.testing.assert_allclose(crossing.place_mm, (100, 100, 7), atol=R)
    assert approach_of(found, line) == pytest.approx(-crossing.depth_mm, abs=1e-4)
    assert found.pairs == 1


def test_a_low_travel_a_lift_and_a_descent_through_ink_are_flagged():
    net = network(BAR)
    job = Job()
    job.along(BAR, 0)
    job.over(100, 97, 5)
    across = job.go(100, 100, 5)
    lift = job.go(100, 100, HIGH)
    down = job.go(100, 100, 6)
    found = {one.line: one for one in job.check(net).crossings}
    assert {line: one.kind for line, one in found.items()} == {
        across: "travel",
        lift: "lift",
        down: "descent",
    }
    assert all(one.crossed == 0 for one in found.values())
    assert found[lift].depth_mm == pytest.approx(R + RADIUS, abs=0.003)


def test_a_dive_into_its_own_filament_is_flagged():
    job = Job()
    points = [(100, 100, 10), (100, 100, 5)]
    (line,) = job.along(points, 0)
    (found,) = job.check(network(points)).crossings
    assert (found.line, found.vessel, found.crossed) == (line, 0, 0)


def heads(raised_mm: float) -> NeedleMotion:
    """Two heads 2 mm apart; the first writes a bar, whose middle the second stands above after."""
    places = [(95, 100, 7), (105, 100, 7), (105, 100, HIGH), (98, 100, HIGH), (98, 100, 5)]
    ends = np.array([*places, places[-1], places[-1]], dtype=float)
    first = np.stack([ends[:-1], ends[1:]], axis=1)
    second = first + [2.0, 0.5, HIGH]
    second[-1] = first[-1] + [2.0, 0.0, raised_mm]
    count = len(first)
    area = np.pi * RADIUS**2
    return NeedleMotion(
        tips=np.stack([first, second]),
        tool=np.append(np.zeros(count - 1, np.int64), 1),
        line=np.arange(1, count + 1),
        volume_ul=np.append(10 * area, np.zeros(count - 1)),
        writes=np.arange(count) == 0,
        vessel=np.append(0, np.full(count - 1, -1)),
    )


def test_a_head_lowered_into_ink_is_flagged_and_a_raised_one_isnt():
    net = network(BAR)
    low = check_clearance(heads(1.0), net, [NEEDLE, NEEDLE])
    assert [(one.line, one.kind, one.head) for one in low.crossings if one.head] == [
        (6, "head change", 1)
    ]
    high = check_clearance(heads(HIGH), net, [NEEDLE, NEEDLE])
    assert [one for one in high.crossings if one.head] == []


CONE = NeedleBody(0.4, tip_radius_mm=0.1, cone_mm=1.0)


@pytest.mark.parametrize(("height", "radius"), [(0.5, 0.25), (2.0, 0.4)])
def test_a_cone_reaches_as_far_as_it_is_wide_there(height, radius):
    y = 100.4
    tip = [(97, y, 7 - height), (103, y, 7 - height)]
    found, line = under(tip, needle=CONE)
    slant = np.hypot(1.0, 0.3) if height < 1 else 1.0
    gap = 0.4 - radius - RADIUS * slant
    assert apart_of(found, line) == pytest.approx(gap / slant, abs=0.004)
    plain = under(tip, needle=NeedleBody(0.1))[0]
    assert plain.crossings == ()
    assert bool(found.crossings) == (gap < 0)


def test_the_result_is_json_with_the_deepest_first():
    found, line = under([(100, 97, 5), (100, 103, 5)])
    data = json.loads(json.dumps(found.as_dict()))
    assert data["crossings"] == 1
    assert data["crossed_pairs"] == 1
    assert data["nearest_line"] == line
    assert data["nearest_mm"] == -data["crossing"][0]["depth_mm"]
    assert f"line {line} (write for vessel 1)" in found.crossings[0].sentence()


CLEAN = {
    "helix": [
        (100 + 3 * np.cos(a), 100 + 3 * np.sin(a), 5 + 0.3 * a) for a in np.linspace(0, 18, 200)
    ],
    "ring": [(100 + 4 * np.cos(a), 100 + 4 * np.sin(a), 5) for a in np.linspace(0, 2 * np.pi, 80)],
    "upright": [(100, 100, 3), (100, 100, 9)],
    "slope down": [(100, 100, 6), (106, 100, 3)],
}


@pytest.mark.parametrize("points", CLEAN.values(), ids=CLEAN.keys())
def test_one_clean_pass_isnt_flagged(points):
    job = Job()
    job.along(points, 0)
    job.over(90, 90, 5)
    assert job.check(network(points)).crossings == ()


def test_a_stack_from_the_bottom_is_clean_and_from_the_top_isnt():
    bars = [[(95, 100, z), (105, 100, z)] for z in (5, 6, 7, 8)]
    up, down = Job(), Job()
    for k in range(4):
        up.along(bars[k], k)
        down.along(bars[3 - k], 3 - k)
    assert up.check(network(*bars)).crossings == ()
    found = down.check(network(*bars))
    assert found.pairs == 6  # each under all that are above it


ARCH = [(100 + 2 * np.cos(a), 100, 5 + 4 * np.sin(a)) for a in np.linspace(0, np.pi, 61)]


def test_a_vessel_cut_too_low_is_flagged():
    job = Job()
    job.along(ARCH[:38], 0)
    last = job.along(ARCH[:36:-1], 0)[-1]
    found = job.check(network(ARCH)).crossings
    assert found == ()  # both tips meet; nothing lies above the lower one but the joint
    job = Job()
    job.along(ARCH[:41], 0)
    job.over(*ARCH[60], 0)
    line = job.write(ARCH[36][0], 100, ARCH[36][2] - 1.5, 0)
    assert line != last
    assert line in {one.line for one in job.check(network(ARCH)).crossings}


STEM = [(100, 100, 3), (100, 100, 7)]


def test_the_same_lines_without_a_shared_node_cross():
    left, right = [(99.865, 100, 7), (96, 98, 8)], [(100.135, 100, 7), (104, 98, 8)]
    job = Job()
    job.along(left, 0)
    job.along(right, 1)
    found = job.check(network(left, right))
    assert {(one.vessel, one.crossed) for one in found.crossings} == {(1, 0)}
    assert found.crossings[0].depth_mm == pytest.approx(0.155 + RADIUS - 0.27, abs=0.003)
    near = [(99.865, 100, 7), (100.135, 100, 7)]  # a short vessel between them is no node of both
    assert job.check(network(left, right, near)).pairs == 1


def test_where_the_network_overlaps_itself_the_shaft_passes_and_it_is_told():
    high, low = [(95, 100, 7), (105, 100, 7)], [(100, 95, 6.8), (100, 105, 6.8)]
    apart = [(100, 95, 6.7), (100, 105, 6.7)]  # they touch, and are two all the same
    for under, overlaps in ((low, 1), (apart, 0)):
        job = Job()
        job.along(high, 0)
        job.along(under, 1)
        found = job.check(network(high, under))
        assert (found.pairs, len(found.overlaps)) == (1 - overlaps, overlaps)
    job = Job()
    job.along(high, 0)
    job.along(low, 1)
    (told,) = job.check(network(high, low)).overlaps
    assert (told.vessel, told.other) == (0, 1)
    assert told.overlap_mm == pytest.approx(2 * RADIUS - 0.2, abs=0.01)
    assert told.place_mm == pytest.approx((100, 100, 7), abs=0.1)
    job.over(101, 97, 6)
    line = job.write(101, 103, 6, 1)  # a millimetre beside the place
    assert [one.line for one in job.check(network(high, low)).crossings] == [line]


def test_a_pass_lasts_until_the_tip_travels_without_ink():
    points = [(95, 100, 7), (99, 100, 7), (103, 100, 7), (103, 104, 7)]
    net, job = network(points[:2], points[1:3], points[2:], radius=0.2), Job()
    job.along(points[:2], 0, 0.2)
    job.plunge(-0.05, 1)  # relieved and primed in place, where the vessel becomes thinner
    job.plunge(0.05, 1)
    job.write(*points[2], 1, 0.1)
    job.over(*points[2], 2)
    job.write(*points[3], 2)
    motion = job.motion()
    (head,) = heads_of(motion, net)
    assert head.passes.run[motion.writes].tolist() == [0, 0, 1]
    ink, _ = ink_of(motion, net, [head], Pieces.of(motion.length_mm))
    for vessel, radius in enumerate((0.2, 0.1, RADIUS)):
        inner = (ink.vessel == vessel) & (np.abs(ink.arc - 4).min(axis=1) > 0.3)
        assert ink.radius[inner] == pytest.approx(radius, rel=1e-3)


def test_what_doesnt_belong_together_is_refused_with_a_word():
    job = Job()
    job.along(STEM, 3)
    with pytest.raises(ClearanceError, match="vessel 3, and the network has 1"):
        job.check(network(STEM))
    with pytest.raises(ClearanceError, match="0 needles for 1 heads"):
        check_clearance(job.motion(), network(STEM), [])
    with pytest.raises(ClearanceError, match=r"tip_radius_mm is 0\.3; give 0 to the shaft's"):
        NeedleBody(NEEDLE.radius_mm, tip_radius_mm=0.3, cone_mm=1)
    assert LineSources(np.zeros(3, np.int64)).writes is None
    assert RADIUS > 0


NEEDLES = [
    NeedleBody(0.2, clearance_mm=0.05),
    NeedleBody(0.5, tip_radius_mm=0.15, cone_mm=1.2, clearance_mm=0.05),
]
OVERLAP = 0.5
GRID = [
    (98 + 1.5 * i + 0.1 * k, 98 + 1.5 * j + 0.13 * i, 4 + 1.5 * k + 0.17 * j + 0.11 * i)
    for i in range(3)
    for j in range(3)
    for k in range(3)
]
"""Farther apart than joints reach, and few enough that vessels often meet."""
place = st.sampled_from(GRID)


def oracle_moves(vessels, radii):
    """The same job as `Job.along` writes, for the oracle."""
    moves, at = [], np.array(START)
    for k, ((a, b), radius) in enumerate(zip(vessels, radii, strict=True)):
        about = {"vessel": k, "nodes": {tuple(a), tuple(b)}, "axis": (np.array(a), np.array(b))}
        high = [np.array([*at[:2], HIGH]), np.array([*a[:2], HIGH]), np.array(a, float)]
        for to in high:
            moves.append(travel(at, to))
            at = to
        end = np.array(b, float)
        moves[-1] |= about | {"beside": radius}
        moves.append({"start": at, "end": end, "radius": radius, "beside": 0.0} | about)
        at = end
    return moves


def travel(start, end):
    return {"start": start, "end": end, "radius": 0.0, "beside": 0, "vessel": -1, "nodes": set()}


@settings(max_examples=examples(12), derandomize=True)  # elsewhere joints end between two samples
@given(
    st.lists(st.tuples(place, place), min_size=2, max_size=4),
    st.sampled_from(NEEDLES),
    st.lists(st.sampled_from([0.1, 0.15, 0.3]), min_size=5, max_size=5),
)
def test_random_jobs_are_judged_as_by_sampling(vessels, needle, radii):
    vessels = [(a, b) for a, b in vessels if a != b]
    if not vessels:
        return
    job, lines = Job(), []
    for k, (points, radius) in enumerate(zip(vessels, radii, strict=False)):
        lines.append(job.along(points, k, radius)[-1])
    found = job.check(network(*vessels), needle, OVERLAP)
    want = nearest(oracle_moves(vessels, radii[: len(vessels)]), needle, OVERLAP, RADIUS)
    for k, line in enumerate(lines):
        for of, sampled in ((line - 1, want[4 * k + 2]), (line, want[4 * k + 3])):
            exact = approach_of(found, of)
            if sampled > 0.9:
                assert exact > 0.8
                continue
            assert exact <= sampled + 0.004 + SEARCH.error_share * max(sampled, 0)
            assert exact >= sampled - 3 * STEP


@pytest.mark.parametrize("needle", NEEDLES)
def test_the_distance_to_a_shaft_is_that_to_its_outline(needle):
    rng = np.random.default_rng(1)
    places = rng.uniform(-1, 1, (300, 3)) * [1, 1, 3]
    rho = np.hypot(places[:, 0], places[:, 1])
    want = signed(rho, places[:, 2], needle)
    found = [shaft_distance(*place, needle.as_row()) for place in places]
    np.testing.assert_allclose(found, want, atol=1e-9)
