"""Trunk branches in each other's way fork later, or are left away."""

from functools import cache

import numpy as np
import pytest

from design.anatomy.clear_trunks import clear_trunks
from design.anatomy.trunk_lines import TrunkLines
from design.errors import GrowthError
from design.tissue import Tissue, tissue_from_surface
from design.tissue.shapes import block
from design.vasculature.options import GrowthOptions

OPTIONS = GrowthOptions(terminals=100, clearance_mm=0.2)


@cache
def tissue() -> Tissue:
    shape = block((40.0, 40.0, 20.0))
    return tissue_from_surface(shape.vertices, shape.faces)


def forked(degrees: float, steps: int = 12) -> tuple[TrunkLines, np.ndarray]:
    """A stem along x in the block's middle that forks into two, a millimetre from node to node."""
    low, high = tissue().bounds
    middle = 0.5 * (low + high)
    begin = np.array([low[0] + 2.0, middle[1], middle[2]])
    half = np.radians(degrees / 2)
    points = [begin + [k, 0, 0] for k in range(6)]
    parent = [-1, *range(5)]
    for side in (1, -1):
        for k in range(1, steps + 1):
            parent.append(5 if k == 1 else len(points) - 1)
            points.append(points[5] + k * np.array([np.cos(half), side * np.sin(half), 0]))
    share = np.array([1.0] * 6 + [0.6] * steps + [0.4] * steps)
    lines = TrunkLines(np.array(points), np.array(parent), np.zeros(len(points), int), share)
    return lines, 0.8 * share ** (1 / OPTIONS.murray_exponent)


def cleared(lines: TrunkLines, radius: np.ndarray) -> tuple[TrunkLines, np.ndarray]:
    """As often as something is in the way."""
    while (found := clear_trunks(tissue(), lines, lines, radius, OPTIONS)) is not None:
        lines, radius = found
    return lines, radius


@pytest.mark.parametrize("degrees", [20.0, 30.0, 45.0])
def test_narrow_forks_move_on_and_no_end_is_lost(degrees):
    before, radius = forked(degrees)
    after, wide = cleared(before, radius)
    assert (after.child_count() == 0).sum() == 2
    assert (after.parent < np.arange(len(after.parent))).all()
    fork = int(np.flatnonzero(after.child_count() == 2)[0])
    assert after.points[fork, 0] > before.points[5, 0]
    # What was the larger branch carries both up to the fork.
    np.testing.assert_allclose(wide[fork], wide[0], rtol=1e-9)
    np.testing.assert_allclose(after.share[fork], 1.0)


def test_a_tree_that_keeps_no_trunk_is_an_error():
    """It said that the trunk has no segments, and to grow without."""
    one, radius = forked(100.0)
    away = one.points + [0, 0, 300.0]
    two = TrunkLines(
        np.concatenate([one.points, away]),
        np.concatenate([one.parent, np.where(one.parent >= 0, one.parent + len(away), -1)]),
        np.repeat([0, 1], len(away)),
        np.tile(one.share, 2) / 2,
    )
    with pytest.raises(GrowthError, match="trunks don't fit"):
        cleared(two, np.tile(radius, 2))
