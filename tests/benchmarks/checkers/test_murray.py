import numpy as np
import pytest

from benchmarks.checkers import (
    Perfusion,
    consistent_radii,
    murray_ratios,
    murray_residual,
)
from tests.benchmarks.checkers.nets import fork, net_of, random_tree


def test_murrays_law_is_kept_by_equal_branches_of_its_ratio():
    branch = 0.1 * 2 ** (-1 / 3)
    assert murray_residual(fork([0.1, branch, branch])) < 1e-15
    assert murray_residual(fork([0.1, branch, branch]), exponent=2.0) > 0.2


def test_a_wrong_radius_is_told():
    branch = 0.1 * 2 ** (-1 / 3)
    assert murray_ratios(fork([0.1, branch, 2 * branch])) == pytest.approx([4.5])
    assert murray_residual(fork([0.1, branch, 2 * branch])) == pytest.approx(3.5)


def test_bends_and_ends_are_no_branches():
    bend = net_of([[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 1], [1, 2]], [0.1, 0.3])
    assert len(murray_ratios(bend)) == 0
    assert murray_residual(bend) == 0


@pytest.mark.parametrize("exponent", [2.0, 2.7, 3.0])
def test_consistent_radii_keep_murrays_law(exponent):
    perfusion = Perfusion(13.0, 5300.0, 4e-3, exponent)
    radius = consistent_radii(random_tree(np.random.default_rng(7), 200), perfusion)
    net = random_tree(np.random.default_rng(7), 200, radius)
    assert murray_residual(net, exponent) < 1e-12


def test_what_is_no_binary_tree_is_refused():
    star = net_of(np.eye(5, 3), [[0, 1], [1, 2], [1, 3], [1, 4]], 0.1)
    with pytest.raises(ValueError, match="binary"):
        consistent_radii(star, Perfusion(1.0, 1.0, 1.0))
