"""Trunks rise to the depth that their radii need, smoothly, with the branches that leave them."""

import numpy as np
import pytest

from design.anatomy.curves import turns
from design.anatomy.trunk_depth import risen_trees
from design.tissue import block
from design.vasculature.treemath import tree_from_topology, tree_radii
from tests.design.tissue.kept import kept_tissue

DEPTH = 1.4
CLEARANCE, SHALLOW = 0.1, 0.3


@pytest.fixture(scope="module")
def box():
    return kept_tissue(block((60.0, 20.0, 20.0)))


@pytest.fixture(scope="module")
def deep():
    """A trunk below the block's top (z = 20), with a branch down from its middle."""
    x = np.arange(5.0, 55.5, 1.0)
    line = np.column_stack([x, np.full(len(x), 10.0), np.full(len(x), 20.0 - DEPTH)])
    middle, n = len(line) // 2, len(line) - 1
    down = line[middle] - np.outer(np.arange(0.0, 8.5, 1.0), [0.0, 0.0, 1.0])
    parent = np.concatenate([np.arange(n) - 1, [middle - 1], n + np.arange(len(down) - 2)])
    children = np.full((len(parent), 2), -1, dtype=np.int32)
    for i, above in enumerate(parent.tolist()):
        if above >= 0:
            children[above, 0 if children[above, 0] < 0 else 1] = i
    return tree_from_topology(
        np.concatenate([line[:-1], down[:-1]]),
        np.concatenate([line[1:], down[1:]]),
        parent.astype(np.int32),
        children,
        flow_ul_s=5.0,
        pressure_drop_pa=20.0,
        murray_exponent=2.5,
        viscosity_pa_s=4e-3,
        given=np.arange(len(parent)) < n,
    )


def nothing(trees):
    return np.empty(0, dtype=np.int64)


def depth(tree, x):
    """Of the trunk's node at a place along it."""
    return 20.0 - tree.distal[tree.given][np.argmin(np.abs(tree.distal[tree.given, 0] - x)), 2]


def test_a_trunk_rises_as_far_as_its_radius_allows_and_without_a_kink(box, deep):
    (risen,) = risen_trees(box, (deep,), CLEARANCE, SHALLOW, nothing)
    need = float(tree_radii(deep)[deep.given].max()) + CLEARANCE
    assert 0.5 < need < DEPTH - 0.3
    assert depth(risen, 28.0) == pytest.approx(need, abs=0.05)
    assert depth(risen, 6.0) > depth(risen, 9.0) > depth(risen, 28.0)
    upper, turn = turns(risen)
    trunk = deep.given[upper]
    assert np.degrees(turn[trunk]).max() < 7.0


def test_a_branch_comes_with_its_trunk_less_and_less(box, deep):
    (risen,) = risen_trees(box, (deep,), CLEARANCE, SHALLOW, nothing)
    up = (risen.distal - deep.distal)[~deep.given, 2]
    assert up[0] > 0.3
    assert (np.diff(up) <= 0.0).all()
    assert (np.diff(up) > -0.2).all()


def test_what_does_not_fit_keeps_its_own_surroundings_down_alone(box, deep):
    """One kink kept all trunks of a heart from rising."""
    place = 12

    def misfit(trees):
        (tree,) = trees
        low = 20.0 - tree.distal[place, 2] < DEPTH - 0.01
        return np.array([place] if low else [], dtype=np.int64)

    (risen,) = risen_trees(box, (deep,), CLEARANCE, SHALLOW, misfit)
    assert depth(risen, deep.distal[place, 0]) == pytest.approx(DEPTH, abs=0.01)
    assert depth(risen, 45.0) < DEPTH - 0.3


def test_nothing_rises_where_nothing_fits(box, deep):
    trees = (deep,)
    assert risen_trees(box, trees, CLEARANCE, SHALLOW, lambda _: np.array([3])) is trees
