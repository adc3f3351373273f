"""Accuracy of the chosen bifurcation, against an exhaustive search, by tree depth.

As in the paper's figure 2C. Accuracy is the part of what can be gained over the segment's middle
that the chosen place gains, both by the exact cost of the whole tree.
"""

import numpy as np
import pytest

from design.tissue import block
from design.vasculature import GrowthOptions, grow_tree
from design.vasculature.growth.bifurcation import split_value
from design.vasculature.growth.cost import Sprout, climb
from design.vasculature.growth.propose import estimate
from design.vasculature.growth.state import SEGMENT, refresh_all, spread_down
from design.vasculature.options import Law
from design.vasculature.penalty import no_penalty
from design.vasculature.treemath import tree_radii
from tests.design.tissue.kept import kept_tissue
from tests.slower import first_rows

ONE = Sprout(1.0, 1.0)
EXACT = 10**9
TRIALS = 60


@pytest.fixture(scope="module")
def grown():
    shape = block((10.0, 10.0, 10.0))
    tree = grow_tree(kept_tissue(shape), GrowthOptions(terminals=1500))
    law = Law(8.0 * tree.viscosity_pa_s / np.pi, tree.murray_exponent, 2.0, 1.0, tree.haematocrit)
    return tree, segments_of(tree, law), law


def segments_of(tree, law):
    """The tree as growing segments, with radii and derivatives of the cost."""
    segments = np.zeros(len(tree.parent), SEGMENT)
    for axis, name in enumerate("xyz"):
        segments[f"p{name}"] = tree.proximal[:, axis]
        segments[f"d{name}"] = tree.distal[:, axis]
    segments["length"] = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    segments["parent"] = tree.parent
    segments["left"], segments["right"] = tree.children.T
    segments["allowed"] = np.inf
    segments["flow"], segments["thick"] = tree.relative_flow, tree.relative_viscosity
    refresh_all(segments, len(segments), law)
    spread_down(segments, len(segments), float(tree_radii(tree)[0]), 1.0, law)
    return segments


def depth_of(tree):
    depth = np.zeros(len(tree.parent), dtype=int)
    for i in range(len(depth)):
        k = tree.parent[i]
        while k >= 0:
            depth[i] += 1
            k = tree.parent[k]
    return depth


def exact_rise(segments, i, b, t, law):
    s = segments[i]
    p, d = np.array([s["px"], s["py"], s["pz"]]), np.array([s["dx"], s["dy"], s["dz"]])
    lengths = [max(1e-6, float(np.linalg.norm(b - x))) for x in (p, d, t)]
    load, spend, *_ = split_value(s, *lengths, ONE, law)
    return climb(segments, i, load, spend, 1.0, EXACT, law)[0]


def resolved(segments, i, t, law):
    """Least exact cost on a grid in the plane of the three ends, refined about the best thrice."""
    s = segments[i]
    p, d = np.array([s["px"], s["py"], s["pz"]]), np.array([s["dx"], s["dy"], s["dz"]])
    centre, reach, best = np.array([0.5, 0.5]), 0.5, np.inf
    for _ in range(4):
        here = centre
        for u in np.linspace(here[0] - reach, here[0] + reach, 13):
            for v in np.linspace(here[1] - reach, here[1] + reach, 13):
                rise = exact_rise(segments, i, p + u * (d - p) + v * (t - p), t, law)
                if rise < best:
                    best, centre = rise, np.array([u, v])
        reach /= 5.0
    return best


def accuracies(grown, low, high):
    tree, segments, law = grown
    rng = np.random.default_rng(low)
    depth = depth_of(tree)
    chosen = rng.permutation(np.flatnonzero((depth >= low) & (depth < high)))[:TRIALS]
    place, slopes = np.empty(3), np.empty(3)
    found = []
    for i in chosen:
        middle = 0.5 * (tree.proximal[i] + tree.distal[i])
        t = middle + rng.normal(0, np.linalg.norm(tree.distal[i] - tree.proximal[i]), 3)
        estimate(segments, i, t, ONE, no_penalty(), place, slopes, law)
        start, best = exact_rise(segments, i, middle, t, law), resolved(segments, i, t, law)
        if start > best * (1 + 1e-6):
            found.append((start - exact_rise(segments, i, place, t, law)) / (start - best))
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("low", "high", "median"), first_rows([(1, 6, 0.6), (6, 12, 0.9), (12, 99, 0.95)])
)
def test_chosen_bifurcation_gains_most_of_what_a_resolved_search_does(grown, low, high, median):
    found = accuracies(grown, low, high)
    assert len(found) > 20
    assert np.median(found) >= median
