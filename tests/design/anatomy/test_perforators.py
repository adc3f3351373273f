"""Many narrow branches dive from a trunk, so that no wide one does."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from design.anatomy.perforators import NARROW, with_perforators
from design.anatomy.trunk_lines import TrunkLines, with_shares
from design.tissue import block
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
