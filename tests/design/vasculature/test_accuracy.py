"""Accuracy of the chosen bifurcation by tree depth, as in the paper's figure 2C.

Cases, costs and optima are those of `benchmarks.paper_places`, by traversals of the whole tree.
"""

import numpy as np
import pytest

from benchmarks.paper_places import cases_of, compare
from design.tissue import block
from design.vasculature import GrowthOptions, grow_tree
from tests.design.tissue.kept import kept_tissue
from tests.slower import first_rows


def grown(terminals):
    return grow_tree(kept_tissue(block((10.0, 10.0, 10.0))), GrowthOptions(terminals=terminals))


@pytest.fixture(scope="module")
def measured():
    tree = grown(1500)
    cases, depth = cases_of(tree, 20)
    return next(compare(tree, cases))[1], depth


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
