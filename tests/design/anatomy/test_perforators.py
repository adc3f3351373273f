"""Many narrow branches dive from a trunk, so that no wide one does."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from design.anatomy.from_trunks import kept_narrow, roots_of
from design.anatomy.perforator_ways import Room, Ways
from design.anatomy.perforators import NARROW, with_perforators
from design.anatomy.trunk_lines import TrunkLines, with_shares
from design.tissue import block
from design.tissue.shapes import annulus
from design.vasculature.growth.forest import grow_forest
from design.vasculature.growth.territories import demand_points
from design.vasculature.options import GrowthOptions
from tests.design.tissue.kept import kept_tissue

OPTIONS = GrowthOptions(terminals=4000, clearance_mm=0.1, murray_exponent=2.5)


@pytest.fixture(scope="module")
def box():
    return kept_tissue(block((60.0, 20.0, 20.0)))


def trunk_along_the_top(box, step=1.0):
    x = np.arange(0.0, 55.5, step)
    points = np.column_stack([x, np.full(len(x), 10.0), np.full(len(x), 18.5)])
    volume, _ = demand_points(box, 8000, 1)
    lines = TrunkLines(points, np.arange(len(x)) - 1, np.zeros(len(x), int), np.zeros(len(x)))
    return with_shares(lines, volume), volume


def test_perforators_reach_all_tissue_and_each_feeds_little(box):
    lines, volume = trunk_along_the_top(box)
    radius = 1.0 * lines.share ** (1 / 2.5)
    count = len(radius)
    whole, wide = with_perforators(box, lines, radius, volume, OPTIONS)
    np.testing.assert_array_equal(whole.points[:count], lines.points)
    np.testing.assert_array_equal(wide[:count], radius)
    first = np.flatnonzero((whole.parent < count) & (np.arange(len(wide)) >= count))
    assert len(first) > 20
    # This trunk has all tissue on one side of it, so that they are long, and feed all along.
    assert np.median(wide[first]) < 1.1 * NARROW * radius[0]
    assert (-box.grid.distance(whole.points[count:]) > OPTIONS.clearance_mm).all()
    before = cKDTree(lines.points).query(volume)[0]
    after = cKDTree(whole.points).query(volume)[0]
    assert np.percentile(before, 95) > 15.0
    assert np.percentile(after, 95) < 7.0


def test_a_perforator_follows_a_thin_wall_around_a_cavity():
    """In a few straight pieces it would cut across the cavity."""
    wall = kept_tissue(annulus(40.0, 38.4, 10.0))
    volume, _ = demand_points(wall, 8000, 1)
    middle = 0.5 * (volume.min(axis=0) + volume.max(axis=0))
    nodes = 17
    trunk = middle + [19.6, 0.0, 0.0] + np.outer(np.linspace(-4.0, 4.0, nodes), [0, 0, 1.0])
    lines = TrunkLines(trunk, np.arange(nodes) - 1, np.zeros(nodes, int), np.zeros(nodes))

    def way_a_quarter_round(piece_mm):
        room = Room(wall, lines, np.full(nodes, 0.15), 0.02, 0.02, piece_mm)
        deep = volume[-wall.grid.distance(volume) >= room.need_mm]
        ways = Ways.through(wall, deep, 0.7 * room.need_mm, lines.points)
        return room.path_to(ways, ways.layer.nearest(middle + [0.0, 19.6, 0.0]))

    path = way_a_quarter_round(1.0)
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).sum() > 25.0
    assert way_a_quarter_round(100.0) is None


def test_perforators_stay_but_are_no_trunks_once_grown(box):
    """Else they would be raised to the epicardium."""
    trunk = np.array([[1.0, 10, 17], [20.0, 10, 17], [40.0, 10, 17]])
    points = np.concatenate([trunk, [[20.0, 10, 9.0], [20.0, 10, 4.0]]])
    parent = np.array([-1, 0, 1, 1, 3])
    lines = TrunkLines(points, parent, np.zeros(5, int), np.ones(5))
    (root,) = roots_of(lines, np.full(5, 0.5), GrowthOptions(terminals=150))
    narrow = kept_narrow(root, trunk, 0.2)
    assert narrow.trunk.planned.tolist() == [False, False, True, True]
    (tree,) = grow_forest(box, [narrow])
    heights = tree.distal[tree.given, 2]
    np.testing.assert_allclose(heights, 17.0, atol=1e-9)
    ends = [places.tobytes() for places in tree.distal]
    assert all(place.tobytes() in ends for place in points[1:])
    (whole,) = grow_forest(box, [root])
    assert whole.distal[whole.given, 2].min() == 4.0
