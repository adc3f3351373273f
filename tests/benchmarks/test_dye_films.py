"""Synthetic dye videos for benchmarks: known flow and optics."""

import numpy as np
import pytest

from benchmarks.checkers.dye_film import STEP_S, Pinhole, _depth, _inside, dyed
from benchmarks.registration.scans import branched

NODES = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]])
SPEED, RADIUS, START = 4.0, 0.25, 1.0


def tube():
    flow = np.pi * RADIUS**2 * SPEED
    return dyed(NODES, np.array([[0, 1]]), np.array([RADIUS]), flow, START, 8.0)


def test_dye_in_a_tube_follows_taylor():
    times = STEP_S * np.arange(801)
    for share in (0.3, 1.0):
        way = 10.0 * share / (2.0 * SPEED)
        exact = np.maximum(0.0, 1.0 - way / np.maximum(times - START, 1e-9))
        assert np.abs(tube().mean(0, share) - exact).max() < 0.02


def test_flow_is_shared_by_resistance_and_closed_vessels_stand_still():
    tree = branched().network
    tubes = dyed(tree.nodes, tree.vessel_nodes, tree.pieces()[2], 4.0, START, 4.0, (3,))
    assert set(np.flatnonzero(tubes.flow == 0.0)) == {3, 7, 8}
    assert tubes.flow[0] == pytest.approx(4.0)
    assert tubes.flow[7:].sum() == pytest.approx(4.0)
    assert np.isnan(tubes.arrival(7, 0.5, 4.0))


def test_a_ray_through_the_axis_sees_the_lumens_width_of_dye():
    camera = Pinhole(201, 101, 18.0, np.array([5.0, 0.0, 0.0]), 500.0)
    tubes = tube()
    depth = _depth(_inside(tubes, camera), tubes, 7.9, camera)
    # At a quarter of the way nearly all but the wall's lines are dyed by then.
    assert depth[50, 55] == pytest.approx(2 * RADIUS, rel=0.1)
    assert depth[50 - 8, 55] == 0.0


def test_rays_go_where_pixels_are_seen():
    camera = Pinhole(64, 48, 20.0, np.array([1.0, 2.0, 3.0]), 100.0, 25.0, 40.0)
    pinhole, way = camera.rays()
    seen = camera.pixels(pinhole + 97.0 * way[[0, 700, 3000]])
    assert seen == pytest.approx(np.array([[0, 0], [700 % 64, 700 // 64], [3000 % 64, 3000 // 64]]))
