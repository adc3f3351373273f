"""Planted shaft collisions: flagged with depth and line; clear jobs pass."""

from __future__ import annotations

import json

import numpy as np
import pytest

from sim.gcode.clearance import NeedleBody, NeedleMotion, check_clearance
from tests.sim.gcode.clearance.small_jobs import (
    HIGH,
    NEEDLE,
    RADIUS,
    Job,
    apart_of,
    approach_of,
    network,
)

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
