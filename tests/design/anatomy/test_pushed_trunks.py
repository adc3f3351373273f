"""Vessels that feed many are pushed apart where they are too near, not taken away."""

import numpy as np
import pytest

from design.anatomy.fit_apart import _sunk, misfits
from design.tissue import block
from design.vasculature.treemath import tree_from_topology, tree_radii
from tests.design.tissue.kept import kept_tissue

CLEARANCE, RATIO = 0.1, 0.1


def straight(y, aside=0.0):
    """One vessel along the block's middle, that begins further aside."""
    x = np.arange(5.0, 55.5, 2.0)
    line = np.column_stack([x, y + aside * np.maximum(1.0 - (x - 5.0) / 15.0, 0.0), 0.0 * x + 10.0])
    n = len(line) - 1
    children = np.column_stack([np.append(np.arange(1, n), -1), np.full(n, -1)])
    return tree_from_topology(
        line[:-1],
        line[1:],
        (np.arange(n) - 1).astype(np.int32),
        children.astype(np.int32),
        flow_ul_s=5.0,
        pressure_drop_pa=20.0,
        murray_exponent=2.5,
        viscosity_pa_s=4e-3,
        given=np.ones(n, dtype=bool),
    )


@pytest.mark.parametrize("lacking_mm", [0.02, 0.15])
def test_trunks_a_little_too_near_are_pushed_apart(lacking_mm):
    """775 of a heart's 8,000 terminals went with a branch that came out 0.26 mm too near."""
    tissue = kept_tissue(block((60.0, 20.0, 20.0)))
    radius = float(tree_radii(straight(10.0))[0])
    apart = 2.0 * radius + max(CLEARANCE, RATIO * radius) - lacking_mm
    trees = (straight(10.0), straight(10.0 + apart, 2.0))
    assert misfits(tissue, trees, CLEARANCE, RATIO)[0]
    done = _sunk(tissue, trees, CLEARANCE, RATIO)
    assert [len(tree.parent) for tree in done] == [len(tree.parent) for tree in trees]
    assert not misfits(tissue, done, CLEARANCE, RATIO)[0]
