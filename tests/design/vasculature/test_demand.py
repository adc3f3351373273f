"""Terminals and flows distributed by the tissue's demand."""

from dataclasses import replace

import numpy as np
import pytest

from design.tissue import block, function_demand
from design.vasculature import (
    GrowthOptions,
    grow_tree,
    supply_balance,
    tree_radii,
)
from tests.design.tissue.kept import kept_tissue
from tests.design.vasculature import oracles

SIZE = (20.0, 16.0, 12.0)


@pytest.fixture(scope="module")
def even():
    shape = block(SIZE)
    return kept_tissue(shape)


@pytest.fixture(scope="module")
def uneven(even):
    """The half of small x asks for four times as much."""
    return replace(even, demand=function_demand(even, lambda p: np.where(p[:, 0] < 10, 4.0, 1.0)))


def tips_of(tree):
    return tree.distal[tree.children[:, 0] < 0]


def tip_flows(tree):
    return tree.flow_ul_s[tree.children[:, 0] < 0]


def test_terminals_are_denser_where_demand_is_higher(even, uneven):
    options = GrowthOptions(terminals=500)
    rich = (tips_of(grow_tree(uneven, options))[:, 0] < 10).mean()
    plain = (tips_of(grow_tree(even, options))[:, 0] < 10).mean()
    assert rich == pytest.approx(0.8, abs=0.05)
    assert plain == pytest.approx(0.5, abs=0.05)


def test_demand_is_ignored_where_the_user_says_so(even, uneven):
    options = GrowthOptions(terminals=200, follow_demand=False)
    one, two = grow_tree(even, options), grow_tree(uneven, options)
    np.testing.assert_array_equal(one.distal, two.distal)


def test_balance_is_better_where_growth_follows_demand(uneven):
    spread = [
        supply_balance(uneven, tips_of(tree), tip_flows(tree)).spread
        for tree in (
            grow_tree(uneven, GrowthOptions(terminals=400, follow_demand=False)),
            grow_tree(uneven, GrowthOptions(terminals=400)),
            grow_tree(uneven, GrowthOptions(terminals=400, terminal_flow="demand")),
        )
    ]
    assert spread[2] < 0.05 < spread[1] < 0.7 * spread[0]


def test_flows_by_demand_are_what_an_independent_solver_finds(uneven):
    options = GrowthOptions(terminals=300, terminal_flow="demand", clearance_mm=0.02)
    tree = grow_tree(uneven, options)
    flows = oracles.terminal_flows(tree, tree_radii(tree))
    np.testing.assert_allclose(flows, tip_flows(tree), rtol=1e-9)
    assert flows.sum() == pytest.approx(options.flow_ul_s(uneven.volume_mm3))
    assert np.ptp(flows) > 2 * flows.mean()
