"""Position penalty on branch points."""

import numpy as np
import pytest

from design.errors import GrowthError
from design.tissue import block
from design.vasculature import DepthPenalty, GrowthOptions, grow_tree
from tests.design.tissue.kept import kept_tissue


@pytest.fixture(scope="module")
def box():
    shape = block((20.0, 16.0, 12.0))
    return kept_tissue(shape)


def joints_of(tree):
    inner = tree.children[:, 0] >= 0
    # The stem's end is where the root's place puts it.
    inner[0] = False
    return tree.distal[inner]


def test_branch_points_keep_away_from_the_surface(box):
    depth = [
        -box.grid.distance(joints_of(grow_tree(box, GrowthOptions(terminals=200, penalty=penalty))))
        for penalty in (None, DepthPenalty((0.0, 2.0), (5.0, 1.0)))
    ]
    assert np.percentile(depth[0], 20) < 1.6
    assert np.percentile(depth[1], 5) > 1.8


def test_branch_points_keep_to_a_region_given_by_a_function(box):
    options = GrowthOptions(terminals=200, penalty=lambda p: np.where(p[:, 0] > 10.0, 2.0, 1.0))
    beyond = [
        (joints_of(grow_tree(box, o))[:, 0] > 10.5).mean()
        for o in (GrowthOptions(terminals=200), options)
    ]
    assert beyond[0] > 0.4
    # Where nothing else fits they still go beyond.
    assert beyond[1] < 0.6 * beyond[0]


@pytest.mark.parametrize(
    ("depth", "factor", "message"),
    [
        ((0.0, 1.0), (1.0,), "2 depths and 1 factors"),
        ((1.0, 0.5), (1.0, 2.0), "doesn't ascend"),
        ((0.0, 1.0), (1.0, 0.0), "factor of 0"),
    ],
)
def test_impossible_tables_are_refused(depth, factor, message):
    with pytest.raises(GrowthError, match=message):
        DepthPenalty(depth, factor)


def test_impossible_functions_are_refused(box):
    with pytest.raises(GrowthError, match="factor of -1"):
        grow_tree(box, GrowthOptions(terminals=5, penalty=lambda p: np.full(len(p), -1.0)))
    with pytest.raises(GrowthError, match="shape"):
        grow_tree(box, GrowthOptions(terminals=5, penalty=lambda p: p))
