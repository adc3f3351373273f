"""Shaft checker, against dense sampling on random jobs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.gcode.clearance import NeedleBody
from sim.gcode.clearance.kernels import ERROR_SHARE, shaft_distance
from tests.sim.gcode.clearance.naive import STEP, nearest, signed
from tests.sim.gcode.clearance.small_jobs import HIGH, RADIUS, START, Job, approach_of, network
from tests.slower import examples

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
            assert exact <= sampled + 0.004 + ERROR_SHARE * max(sampled, 0)
            assert exact >= sampled - 3 * STEP


@pytest.mark.parametrize("needle", NEEDLES)
def test_the_distance_to_a_shaft_is_that_to_its_outline(needle):
    rng = np.random.default_rng(1)
    places = rng.uniform(-1, 1, (300, 3)) * [1, 1, 3]
    rho = np.hypot(places[:, 0], places[:, 1])
    want = signed(rho, places[:, 2], needle)
    found = [shaft_distance(*place, needle.as_row()) for place in places]
    np.testing.assert_allclose(found, want, atol=1e-9)
