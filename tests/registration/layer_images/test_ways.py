"""Places along lines, and where lines lie over each other."""

import numpy as np

from registration.layer_images import ExpectedLines
from registration.layer_images.ways import lay_ways


def _crossed(*points: tuple[float, float, float]) -> float:
    """Share of a line's places over which it lies itself."""
    at = np.array(points)
    count = np.arange(len(at) - 1)
    lines = ExpectedLines(
        at[:-1], at[1:], np.full(len(count), 0.4), count, 0 * count, count >= 0
    )
    return float(lay_ways(lines, 0.05).crossed.mean())


def test_a_steep_line_does_not_cross_itself() -> None:
    assert _crossed((0, 0, 0), (3, 0, 3)) == 0.0
    assert _crossed((0, 0, 0), (2, 0, 3), (4, 0, 0)) == 0.0


def test_a_line_that_turns_back_above_itself_does() -> None:
    assert _crossed((0, 0, 0), (3, 0, 3), (0, 0, 6)) > 0.95
