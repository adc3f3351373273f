"""Reflections of walls, taken out of the share of gel."""

from __future__ import annotations

import numpy as np
import pytest

from registration.segmentation.reflections import without_lines

DEPTH, WALL = 60, 30


def share(line: float, down: bool) -> np.ndarray:
    """Gel below (or above) a level wall in the middle of voxel `WALL`, with a bright line there."""
    column = np.where(np.arange(DEPTH) < WALL, 0.0, 1.0)
    column[WALL] = 0.5 + line
    values = np.broadcast_to(column[:, None, None], (DEPTH, 12, 12)).astype(np.float32).copy()
    return values if down else values[::-1].copy()


@pytest.mark.parametrize("down", [True, False])
@pytest.mark.parametrize("line", [1.0, 4.0, 30.0])
def test_a_line_doesnt_move_the_wall(line: float, down: bool):
    gel = without_lines(share(line, down), 1).sum(axis=0)
    np.testing.assert_allclose(gel, DEPTH - WALL - 0.5, atol=0.3)


def test_a_wall_without_a_line_stays_as_it_is():
    np.testing.assert_array_equal(without_lines(share(0.0, True), 1), share(0.0, True))


def test_a_bright_particle_within_gel_stays():
    values = np.ones((DEPTH, 12, 12), np.float32)
    values[WALL] = 5.0
    np.testing.assert_array_equal(without_lines(values.copy(), 1), values)
