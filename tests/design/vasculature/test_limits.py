"""Limits on branching angles and flow split, in finished trees."""

import pytest

from design.errors import GrowthError
from design.tissue import annulus, block
from design.vasculature import GrowthOptions, grow_tree
from tests.design.tissue.kept import KeptTissues
from tests.design.vasculature import oracles
from tests.slower import first_of

LIMITS = (
    {"branch_angle_degrees": (45.0, 90.0)},
    {"turn_angle_degrees": (0.0, 60.0)},
    {"turn_angle_degrees": (10.0, 90.0)},
    {"flow_ratio": 0.2},
    {"branch_angle_degrees": (30.0, 140.0), "turn_angle_degrees": (0.0, 80.0), "flow_ratio": 0.05},
)


@pytest.fixture(scope="module")
def tissues():
    shapes = {"block": lambda: block((20, 16, 12)), "annulus": lambda: annulus(30, 20, 6)}
    return KeptTissues(shapes)


def check(tree, limits):
    branch, turn, ratio = oracles.joints(tree)
    low, high = limits.get("branch_angle_degrees", (0, 180))
    assert branch.min() >= low - 1e-4
    assert branch.max() <= high + 1e-4
    low, high = limits.get("turn_angle_degrees", (0, 180))
    assert turn.min() >= low - 1e-4
    assert turn.max() <= high + 1e-4
    assert ratio.min() >= limits.get("flow_ratio", 0) - 1e-9


@pytest.mark.parametrize("name", ["block", "annulus"])
@pytest.mark.parametrize("limits", LIMITS)
@pytest.mark.parametrize("seed", first_of(range(3)))
def test_every_joint_keeps_the_limits(tissues, name, limits, seed):
    options = GrowthOptions(terminals=120, seed=seed, clearance_mm=0.02, **limits)
    tree = grow_tree(tissues[name], options)
    assert (tree.children[:, 0] < 0).sum() == 120
    check(tree, limits)


def test_a_free_tree_breaks_all_of_them(tissues):
    branch, turn, ratio = oracles.joints(grow_tree(tissues["block"], GrowthOptions(terminals=120)))
    assert branch.min() < 45
    assert branch.max() > 90
    assert turn.max() > 90
    assert turn.min() < 10
    assert ratio.min() < 0.05


def test_printable_tree_keeps_them_through_pruning_and_new_tips(tissues):
    limits = {"branch_angle_degrees": (30.0, 120.0), "turn_angle_degrees": (0.0, 85.0)}
    options = GrowthOptions(terminals=100, smallest_radius_mm=0.08, clearance_mm=0.08, **limits)
    check(grow_tree(tissues["block"], options), limits)


@pytest.mark.slow
def test_limits_that_leave_no_tree_are_told(tissues):
    options = GrowthOptions(terminals=60, branch_angle_degrees=(170.0, 175.0))
    with pytest.raises(GrowthError):
        grow_tree(tissues["block"], options, attempts=1)


@pytest.mark.parametrize("name", ["branch_angle_degrees", "turn_angle_degrees"])
@pytest.mark.parametrize("value", [(90.0, 30.0), (-5.0, 30.0), (0.0, 190.0), (0.0,)])
def test_impossible_angles_are_refused(name, value):
    with pytest.raises(GrowthError, match=f"{name} is .*least and a greatest angle"):
        GrowthOptions(**{name: value})
