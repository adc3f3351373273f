"""Accuracy of the chosen bifurcation by tree depth, as in the paper's figure 2C.

Cases, costs and optima are those of `bifurcation_places`, by traversals of the whole tree.
"""

import numpy as np
import pytest

from design.tissue import block
from design.vasculature import GrowthOptions, grow_tree
from tests.design.tissue.kept import kept_tissue
from tests.design.vasculature.bifurcation_places import (
    accuracies,
    cases_of,
    order_down,
    traversed_cost,
)
from tests.design.vasculature.oracles import volume
from tests.slower import first_rows


def grown(terminals):
    return grow_tree(kept_tissue(block((10.0, 10.0, 10.0))), GrowthOptions(terminals=terminals))


@pytest.fixture(scope="module")
def measured():
    tree = grown(1500)
    cases, depth = cases_of(tree, 20)
    return accuracies(tree, cases), depth


@pytest.mark.slow
@pytest.mark.parametrize(
    ("low", "high", "median"), first_rows([(1, 6, 60), (6, 12, 90), (12, 99, 95)])
)
def test_chosen_bifurcation_gains_most_of_what_a_fine_search_does(measured, low, high, median):
    accuracy, depth = measured
    there = accuracy[(depth >= low) & (depth < high)]
    assert len(there) > 20
    assert accuracy.max() <= 100 + 1e-3
    assert np.median(there) >= median


def test_cost_by_traversals_is_the_volume():
    tree = grown(60)
    length = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    cost = traversed_cost(order_down(tree.children, len(length)), tree.children, length, 3.0)
    unit = 8 * tree.viscosity_pa_s / np.pi * tree.terminal_flow_ul_s / tree.pressure_drop_pa
    assert np.pi * unit**0.5 * cost == pytest.approx(volume(tree), rel=1e-12)
