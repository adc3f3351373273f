"""Intended joints are exempt from the shaft check, nothing else is."""

from __future__ import annotations

import numpy as np
import pytest

from sim.gcode.clearance import ClearanceError, LineSources, NeedleBody, check_clearance
from sim.gcode.clearance.motion import Pieces, heads_of, ink_of
from tests.sim.gcode.clearance.small_jobs import NEEDLE, RADIUS, Job, network

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
    with pytest.raises(ClearanceError, match=r"tip_radius_mm 0\.3 isn't between 0 and"):
        NeedleBody(NEEDLE.radius_mm, tip_radius_mm=0.3, cone_mm=1)
    assert LineSources(np.zeros(3, np.int64)).writes is None
    assert RADIUS > 0
