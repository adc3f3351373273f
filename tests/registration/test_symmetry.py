"""Vessels and freedoms under motions after which a design is the same."""

import manifold3d
import numpy as np
import pytest

from registration.alignment.distance import ModelSurface
from registration.alignment.symmetry import moved_vessels, turns_into_itself
from registration.measuring.judging.symmetry import same_poses
from tests.printctl.networks import vessels
from tests.registration.parts import solid

AHEAD, BACK = ((0, 1, 1), (6, 1, 1)), ((6, 3, 1), (0, 3, 1))
HALF_TURN = np.array([[-1.0, 0, 0, 6], [0, -1, 0, 4], [0, 0, 1, 0], [0, 0, 0, 1]])
MIDDLE = np.zeros(3)
TURN, SHIFT = np.array([0, 0, 0.3, 0, 0, 0]), np.array([0, 0, 0, 0, 0, 1.0])


def test_a_half_turn_swaps_parallel_vessels() -> None:
    network = vessels(AHEAD, BACK, ((0, 2, 1), (6, 2, 1)))
    assert moved_vessels(network, HALF_TURN) == (1, 0, 2)
    assert moved_vessels(network, np.eye(4)) == (0, 1, 2)


def test_a_network_that_comes_to_lie_elsewhere_has_no_such_names() -> None:
    assert moved_vessels(vessels(AHEAD, ((0, 3.5, 1), (6, 3.5, 1))), HALF_TURN) == ()


@pytest.mark.parametrize(
    ("aside", "twist", "same"), [(0.0, TURN, True), (0.5, TURN, False), (0.0, SHIFT, False)]
)
def test_a_tube_is_the_same_after_any_turn_about_its_axis(
    aside: float, twist: np.ndarray, same: bool
) -> None:
    tube = manifold3d.Manifold.cylinder(6.0, 3.0, 3.0, 96, True)
    lumen = manifold3d.Manifold.cylinder(8.0, 0.4, 0.4, 32, True).translate((aside, 0, 0))
    surface = ModelSurface.of(solid(tube - lumen))
    assert turns_into_itself(surface, twist, MIDDLE) == same


def test_poses_are_completed_to_the_designs_whole_group() -> None:
    rivals = [
        {"lead": 1.0, "same": True, "differs_um": 1.0, "vessels": names}
        for names in ([1, 2, 3, 0], [1, 0, 3, 2])
    ]
    assert len(same_poses({"rivals": rivals})) == 7
    assert same_poses({"rivals": [rivals[0] | {"lead": 2.0}]}) == []
