"""Joints that are meant are spared, and nothing else of the vessels that meet."""

from __future__ import annotations

import numpy as np
import pytest

from sim.clearance import ClearanceError, LineSources, NeedleBody, check_clearance
from tests.sim.clearance.small_jobs import NEEDLE, RADIUS, Job, approach_of, network

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


def test_a_vessel_cut_at_its_top_is_closed_from_both_sides():
    job = Job()
    job.along(ARCH[:31], 0)
    job.along(ARCH[:29:-1], 0)
    job.over(90, 90, 5)
    assert job.check(network(ARCH)).crossings == ()


def test_a_vessel_cut_too_low_is_flagged():
    job = Job()
    job.along(ARCH[:41], 0)
    last = job.along(ARCH[:39:-1], 0)[-1]
    found = job.check(network(ARCH)).crossings
    assert found == ()  # both tips meet; nothing lies above the lower one but the joint
    job = Job()
    job.along(ARCH[:41], 0)
    job.over(*ARCH[60], 0)
    line = job.write(ARCH[36][0], 100, ARCH[36][2] - 1.5, 0)
    assert line != last
    assert line in {one.line for one in job.check(network(ARCH)).crossings}


FORK = (100, 100, 7)
STEM, LEFT, RIGHT = [(100, 100, 3), FORK], [FORK, (96, 98, 8)], [FORK, (104, 98, 8)]


def test_a_fork_written_upward_is_clean():
    job = Job()
    job.along(STEM, 0)
    job.write(*LEFT[1], 1)
    job.along(RIGHT, 2)
    job.over(90, 90, 5)
    assert job.check(network(STEM, LEFT, RIGHT)).crossings == ()


def test_a_stem_under_branches_that_are_there_is_flagged():
    job = Job()
    job.along(LEFT, 1)
    line = job.along(STEM, 0)[-1]
    found = job.check(network(STEM, LEFT)).crossings
    assert found
    assert found[0].line in (line, line - 1)  # the way down to its foot crosses, too
    assert (found[0].vessel, found[0].crossed) == (0, 1)


def test_the_same_lines_without_a_shared_node_cross():
    left, right = [(99.9, 100, 7), (96, 98, 8)], [(100.1, 100, 7), (104, 98, 8)]
    job = Job()
    job.along(left, 0)
    job.along(right, 1)
    assert {(one.vessel, one.crossed) for one in job.check(network(left, right)).crossings} == {
        (1, 0)
    }
    near = [(99.9, 100, 7), (100.1, 100, 7)]  # a short vessel joins their ends
    assert job.check(network(left, right, near)).crossings == ()


def test_a_lift_at_a_passes_end_is_judged_like_the_write_there():
    job = Job()
    job.along(RIGHT, 1)
    (line,) = job.along([(96, 98, 6.5), FORK], 0)
    lift = job.over(90, 90, 5) - 2
    net = network([(96, 98, 6.5), FORK], RIGHT)
    found = job.check(net)
    assert found.crossings == ()
    assert approach_of(found, lift) >= approach_of(found, line) - 0.01
    job.over(100, 100, 5)  # but nobody comes back there without a pass
    assert job.check(net).crossings[0].kind == "descent"


def test_a_purge_of_no_vessel_is_ink_like_any_other():
    job = Job()
    job.along([(95, 100, 7), (105, 100, 7)], -1)
    points = [(100, 97, 5), (100, 103, 5)]
    job.along(points, 0)
    (found,) = job.check(network(points)).crossings
    assert (found.vessel, found.crossed) == (0, None)
    assert "ink of no vessel" in found.sentence()


def test_nothing_written_is_no_crossing():
    job = Job()
    job.over(90, 90, 5)
    found = job.check(network([(0, 0, 0), (1, 0, 0)]))
    assert found.summary()["nearest_mm"] is None
    assert np.isinf(found.approach_mm).all()


def test_what_doesnt_belong_together_is_refused_with_a_word():
    job = Job()
    job.along(STEM, 3)
    with pytest.raises(ClearanceError, match="vessel 3, and the network has 1"):
        job.check(network(STEM))
    with pytest.raises(ClearanceError, match="0 needles for 1 heads"):
        check_clearance(job.motion(), network(STEM), [])
    with pytest.raises(ClearanceError, match=r"tip_radius_mm 0\.3 isn't between 0 and"):
        NeedleBody(NEEDLE.radius_mm, tip_radius_mm=0.3, cone_mm=1)
    assert LineSources(np.zeros(3, np.int64)).writes is None
    assert RADIUS > 0
