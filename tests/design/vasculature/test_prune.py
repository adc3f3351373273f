"""Pruning of trees with too-wide vessels."""

import numpy as np
import pytest

from design.tissue import block
from design.vasculature import GrowthOptions
from design.vasculature.growth.prune import prune
from design.vasculature.growth.surroundings import Surroundings
from design.vasculature.growth.tree_growth import TreeGrowth
from tests.design.tissue.kept import kept_tissue

TERMINALS = 3000


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


def test_repair_of_what_is_pruned_ends_with_every_terminal(growth):
    s = growth.segments[: growth.count]
    rng = np.random.default_rng(5)
    s["allowed"][rng.choice(np.arange(1, growth.count), 60, replace=False)] = 0.0
    growth.repair()
    for _ in range(10):
        growth.grow()
        if growth.audit() == 0:
            break
        growth.repair()
    assert growth.terminals == TERMINALS
    assert growth.audit() == 0
