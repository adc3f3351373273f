"""Root search: the cheapest root of those tried."""

from dataclasses import replace

import numpy as np
import pytest

from design.errors import DesignError, GrowthError
from design.tissue import block
from design.vasculature import GrowthOptions, grow_forest, grow_tree
from design.vasculature.growth.grow import PROBES
from design.vasculature.growth.root import search_root
from tests.design.tissue.kept import kept_tissue
from tests.design.vasculature import oracles


@pytest.fixture(scope="module")
def slab():
    shape = block((30.0, 10.0, 6.0))
    return kept_tissue(shape)


def test_the_cheapest_candidate_wins_and_the_note_says_so(slab):
    options = GrowthOptions(terminals=150, root_candidates=10)
    tree = grow_tree(slab, options)
    found = search_root(slab, options, lambda t, o: grow_tree(t, o, attempts=PROBES))
    costs = []
    for point, way in zip(found.points, found.directions, strict=True):
        placed = replace(
            options, root_candidates=0, root_point_mm=tuple(point), root_direction=tuple(way)
        )
        try:
            costs.append(oracles.volume(grow_tree(slab, placed, attempts=PROBES)) / np.pi)
        except DesignError:
            costs.append(np.inf)
    np.testing.assert_allclose(found.cost, costs, rtol=1e-9)
    best = int(np.argmin(costs))
    np.testing.assert_array_equal(tree.proximal[0], found.points[best])
    assert "of 10 places tried" in tree.notes[0]
    assert "({:.4g}, {:.4g}, {:.4g})".format(*found.points[best]) in tree.notes[0]
    again = grow_tree(slab, options)
    assert again.distal.tobytes() == tree.distal.tobytes()
    assert again.notes == tree.notes


def test_a_search_goes_with_nothing_that_places_the_root(slab):
    with pytest.raises(GrowthError, match="either root_point_mm or root_candidates"):
        GrowthOptions(root_candidates=3, root_point_mm=(0.0, 0.0, 0.0))
    with pytest.raises(GrowthError, match="give each of several trees its"):
        grow_forest(slab, [GrowthOptions(terminals=5, root_candidates=3)])
