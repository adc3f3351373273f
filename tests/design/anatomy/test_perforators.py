"""Many narrow branches dive from a trunk, so that no wide one does."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from design.anatomy.from_trunks import _with_trunks
from design.anatomy.perforators import NARROW, with_perforators
from design.anatomy.trunk_lines import TrunkLines, with_shares
from design.tissue import block
from design.vasculature.growth.territories import demand_points
from design.vasculature.options import GrowthOptions
from design.vasculature.treemath import tree_from_topology
from tests.design.tissue.kept import kept_tissue

OPTIONS = GrowthOptions(terminals=4000, clearance_mm=0.1, murray_exponent=2.5)


@pytest.fixture(scope="module")
def box():
    return kept_tissue(block((60.0, 20.0, 20.0)))


def trunk_along_the_top(box):
    x = np.arange(0.0, 55.5, 1.0)
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


def test_few_terminals_get_few_perforators(box):
    lines, volume = trunk_along_the_top(box)
    radius = 1.0 * lines.share ** (1 / 2.5)
    few = GrowthOptions(terminals=60, clearance_mm=0.1, murray_exponent=2.5)
    whole, _ = with_perforators(box, lines, radius, volume, few)
    begins = (whole.parent < len(radius)) & (np.arange(len(whole.parent)) >= len(radius))
    assert begins.sum() <= 8


def test_without_room_there_are_none(box):
    lines, volume = trunk_along_the_top(box)
    radius = 300.0 * lines.share ** (1 / 2.5)
    whole, _ = with_perforators(box, lines, radius, volume, OPTIONS)
    assert len(whole.parent) == len(lines.parent)


def test_perforators_are_no_trunks_once_grown():
    """Else they would be raised to the epicardium."""
    trunk = np.array([[0.0, 0, 0], [10.0, 0, 0], [20.0, 0, 0]])
    planned = np.concatenate([trunk, [[10.0, 0, -8.0]]])
    # The perforator was parted by a branch halfway down, the trunk's first piece by one at 4.
    begin = np.array([[0, 0, 0], [4, 0, 0], [10, 0, 0], [10, 0, 0], [10, 0, -4]], dtype=float)
    end = np.array([[4, 0, 0], [10, 0, 0], [20, 0, 0], [10, 0, -4], [10, 0, -8]], dtype=float)
    side_begin, side_end = end[[0, 3]], end[[0, 3]] + [0.0, 3.0, 0.0]
    parent = np.array([-1, 0, 1, 1, 3, 0, 3], dtype=np.int32)
    children = np.array([[1, 5], [2, 3], [-1, -1], [4, 6], [-1, -1], [-1, -1], [-1, -1]])
    tree = tree_from_topology(
        np.concatenate([begin, side_begin]),
        np.concatenate([end, side_end]),
        parent,
        children.astype(np.int32),
        flow_ul_s=5.0,
        pressure_drop_pa=20.0,
        murray_exponent=2.5,
        viscosity_pa_s=4e-3,
        given=np.arange(7) < 5,
    )
    kept = _with_trunks(tree, trunk, planned).given
    assert kept.tolist() == [True, True, True, False, False, False, False]
