import numpy as np

from design.vasculature import PLANAR_BLOCK_MM, PLANAR_DIMPLES, planar_four_vessel


def test_planar_network_is_as_stated():
    network = planar_four_vessel()
    assert network.vessel_count == 14
    start, end, r0, r1, _ = network.pieces()
    np.testing.assert_array_equal(r0, r1)
    assert (network.points[:, 2] == 1.5).all()
    wide = r0 == 0.5
    channels = (np.abs(end - start)[:, 0] == 10.0) & (start[:, 0] == 3.0)
    np.testing.assert_array_equal(start[channels][:, 1], [1.4, 3.2, 5.0, 6.8])
    np.testing.assert_array_equal(2 * r0[channels], [0.4, 0.5, 0.6, 0.8])
    for x in (3.0, 13.0):
        here = wide & (start[:, 0] == x) & (end[:, 0] == x)
        ys = np.concatenate([start[here][:, 1], end[here][:, 1]])
        assert (ys.min(), ys.max()) == (1.4, 6.8)
        assert np.isclose(np.abs(end - start)[here][:, 1].sum(), 5.4)


def test_planar_network_has_one_inlet_and_one_outlet():
    network = planar_four_vessel()
    inlets, outlets = network.inlets(), network.outlets()
    np.testing.assert_array_equal(network.nodes[inlets], [[0, 4.1, 1.5]])
    np.testing.assert_array_equal(network.nodes[outlets], [[16, 4.1, 1.5]])
    assert sorted(network.degree().tolist()) == [1, 1] + [2] * 4 + [3] * 6


def test_dimples_mark_the_corner_of_the_top_face():
    assert PLANAR_BLOCK_MM == (16.0, 8.0, 3.0)
    assert [d.centre_mm for d in PLANAR_DIMPLES] == [(1.5, 1, 3), (14.5, 1, 3), (1.5, 7, 3)]
    assert {d.diameter_mm for d in PLANAR_DIMPLES} == {0.6}
