"""Wall reflections removed from the gel share."""

from __future__ import annotations

import numpy as np
import pytest

from registration.segmentation.reflections import without_lines

DEPTH, WALL = 60, 30
FAINT = pytest.param(
    1.0,
    marks=pytest.mark.xfail(
        strict=True, reason="a line as bright as gel passes for its speckle: 2 voxels into liquid"
    ),
)


def share(line: float, down: bool) -> np.ndarray:
    """Gel below (or above) a level wall in the middle of voxel `WALL`, with a bright line there."""
    column = np.where(np.arange(DEPTH) < WALL, 0.0, 1.0)
    column[WALL] = 0.5 + line
    values = np.broadcast_to(column[:, None, None], (DEPTH, 12, 12)).astype(np.float32).copy()
    return values if down else values[::-1].copy()


def inside(values: np.ndarray) -> np.ndarray:
    """Gel two voxels from the wall and more."""
    return (np.roll(values, 2, axis=0) >= 1) & (np.roll(values, -2, axis=0) >= 1) & (values == 1)


def speckled(seed: int) -> np.ndarray:
    """A wall of gel under fully developed speckle, one look."""
    rng = np.random.default_rng(seed)
    mean = np.where(np.arange(DEPTH) < WALL, 0.02, 1.0)[:, None, None]
    return (mean * rng.exponential(size=(DEPTH, 80, 80))).astype(np.float32)


def held(values: np.ndarray, gel: np.ndarray) -> float:
    """Mean voxels of gel in a column, reflections taken out."""
    clean = np.minimum(without_lines(values.copy(), gel, 1.5), 1.5)
    return float(clean.sum(axis=0).mean() / clean[gel].mean())


def deep(values: np.ndarray) -> np.ndarray:
    """Gel six voxels from the wall and more."""
    below = np.arange(DEPTH) >= WALL + 6
    return np.broadcast_to(below[:, None, None], values.shape).copy()


@pytest.mark.parametrize("down", [True, False])
@pytest.mark.parametrize("line", [FAINT, 4.0, 30.0])
def test_a_line_doesnt_move_the_wall(line: float, down: bool):
    values = speckled(4)
    values[WALL] *= 0.5
    gel = deep(values)
    values[WALL] += line
    values, gel = (values, gel) if down else (values[::-1].copy(), gel[::-1].copy())
    assert held(values, gel) == pytest.approx(DEPTH - WALL - 0.5, abs=0.3)


def test_speckle_of_a_wall_without_a_line_isnt_taken_for_one():
    values = speckled(3)
    before = np.minimum(values, 1.5)
    after = np.minimum(without_lines(values.copy(), deep(values), 1.5), 1.5)
    assert after.sum(axis=0).mean() == pytest.approx(before.sum(axis=0).mean(), abs=0.05)
