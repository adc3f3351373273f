"""Pruning of trees with too-wide vessels."""

from __future__ import annotations

import numpy as np
import pytest

from design.tissue import block
from design.vasculature import GrowthOptions
from design.vasculature.growth.prune import prune
from design.vasculature.growth.surroundings import Surroundings
from design.vasculature.growth.tree_growth import TreeGrowth
from tests.design.tissue.kept import kept_tissue

TERMINALS = 3000


def whole(segments):
    """Whether parents, children, ends and numbers of terminals agree."""
    inner = np.flatnonzero(segments["left"] >= 0)
    for side in ("left", "right"):
        child = segments[side][inner]
        assert (segments["parent"][child] == inner).all()
        for axis in "xyz":
            assert (segments[f"p{axis}"][child] == segments[f"d{axis}"][inner]).all()
    below = sum(segments["terminals"][segments[side][inner]] for side in ("left", "right"))
    assert (segments["terminals"][inner] == below).all()
    assert (segments["terminals"][segments["left"] < 0] == 1).all()
    return len(segments) == 2 * segments["terminals"][0] - 1


@pytest.fixture
def growth():
    shape = block((20.0, 16.0, 12.0))
    tissue = kept_tissue(shape)
    growth = TreeGrowth.open(tissue, GrowthOptions(terminals=TERMINALS), Surroundings(), 1.7, 0)
    growth.start()
    growth.grow()
    growth.audit()
    return growth


def pruned(growth, smallest):
    args = growth.segments, growth.count, growth.index, growth.room, growth.options.law
    growth.progress["count"] = prune(*args, smallest)
    return growth.segments[: growth.count]


@pytest.mark.parametrize("smallest", [0.0, np.inf], ids=["tips may move", "tips stay"])
def test_a_vessel_that_is_too_wide_loses_what_makes_it_thin_enough(growth, smallest):
    s = growth.segments[: growth.count]
    wide = int(np.argmin(np.abs(s["terminals"] - 800)))
    fed = int(s["terminals"][wide])
    s["allowed"] = np.inf
    s["allowed"][wide] = 0.97 * s["radius"][wide]
    left = pruned(growth, smallest)
    assert whole(left)
    lost = TERMINALS - left["terminals"][0]
    thin_enough = 1.0 - (0.98 * 0.97) ** growth.options.law.gamma
    assert thin_enough * fed - 2 <= lost <= thin_enough * fed + 2


def test_terminals_in_the_way_cost_few_others(growth):
    # A vessel is seldom straight enough to do without its branch: those that aren't must not take
    # the branches above with them, up to the root.
    s = growth.segments[: growth.count]
    s["allowed"] = np.inf
    tips = np.flatnonzero(s["left"] < 0)[::10]
    s["allowed"][tips] = 0.9 * s["radius"][tips]
    left = pruned(growth, 0.0)
    assert whole(left)
    assert TERMINALS - left["terminals"][0] <= 1.05 * len(tips)
