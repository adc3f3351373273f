"""Assignment of a job's moves to stretches of vessels."""

from __future__ import annotations

import numpy as np
import pytest

from sim.gcode.clearance import WrittenNetwork

STRAIGHT = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [3.0, 0.0, 0.0]])


def one_vessel() -> WrittenNetwork:
    return WrittenNetwork(
        STRAIGHT[[0, -1]], np.array([[0, 1]]), np.array([0, 3]), STRAIGHT, np.full(3, 0.1)
    )


@pytest.mark.parametrize(
    ("x", "along"), [((2.0, 1.0), (2.0, 1.0)), ((2.0, -0.5), (2.0, -0.5)), ((1.0, 3.4), (1.0, 3.4))]
)
def test_a_row_past_its_vessels_end_counts_on(
    x: tuple[float, float], along: tuple[float, float]
) -> None:
    start, end = np.array([[x[0], 0.05, 0.0]]), np.array([[x[1], 0.05, 0.0]])
    assert one_vessel().spans(np.array([0]), start, end)[0][0] == pytest.approx(along)


def test_a_row_of_no_vessel_is_nowhere_along_it() -> None:
    empty = WrittenNetwork(
        np.zeros((0, 3)), np.zeros((0, 2), np.int64), np.zeros(1, np.int64), np.zeros((0, 3)),
        np.zeros(0),
    )  # fmt: skip
    for network in (one_vessel(), empty):
        found = network.spans(np.array([-1]), np.zeros((1, 3)), np.ones((1, 3)))
        assert (found[0] == 0).all()
