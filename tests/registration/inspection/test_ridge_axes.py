"""Nearest middles of lines, against all pieces one by one."""

from __future__ import annotations

import numpy as np
import pytest

from registration.inspection.ridges.ridge_axes import are_near, axes_of, nearest_axis
from registration.inspection.values import ExpectedLines

_WIDTH = 0.4


def zigzag() -> tuple[ExpectedLines, np.ndarray]:
    """A stroke there and back, and a short one across; an older line lies beside."""
    rng = np.random.default_rng(7)
    corners = np.array([[(0.0, k), (5.0, k)][:: 1 if k % 2 else -1] for k in range(6)])
    points = np.column_stack([0.38 * corners.reshape(-1, 2), np.full(12, 0.3)])
    across = np.array([[0.4, 3.0, 0.3], [1.1, 3.4, 0.3], [5.0, 9.0, 0.3]])
    start, end = (np.vstack([points[k : k + 11], across[k : k + 2]]) for k in (0, 1))
    stroke = np.array([0] * 11 + [1, 2])
    fresh = stroke < 2
    lines = ExpectedLines(start, end, np.full(13, _WIDTH), np.arange(13), stroke, fresh)
    return lines, rng.uniform(-1.0, 4.5, (400, 2))


def by_hand(
    lines: ExpectedLines, at: np.ndarray, stroke: int, along: float, half: float
) -> np.ndarray:
    """Vector from the nearest of very many points along all fresh lines."""
    begun, best = dict[int, float](), np.full(2, np.inf)
    for start, end, own, fresh in zip(
        lines.start, lines.end, lines.stroke, lines.fresh, strict=True
    ):
        length = float(np.linalg.norm(end - start))
        share = np.linspace(0.0, 1.0, 2001)
        way = begun.get(int(own), 0.0) + share * length
        begun[int(own)] = begun.get(int(own), 0.0) + length
        left = share[(own != stroke) | (np.abs(way - along) >= half)]
        if not fresh or not len(left):
            continue
        off = at - (start[:2] + left[:, None] * (end - start)[:2])
        one = off[np.linalg.norm(off, axis=1).argmin()]
        best = one if np.linalg.norm(one) < np.linalg.norm(best) else best
    return best


@pytest.mark.parametrize("half", [0.0, 0.45])
def test_the_nearest_line_is_found_with_and_without_a_stretch(half: float) -> None:
    lines, places = zigzag()
    axes = axes_of(lines)
    near = are_near(axes, places, 0.3)
    for place, is_near in zip(places, near, strict=True):
        true = by_hand(lines, place, 0, 4.0, half)
        far, x, y = nearest_axis(axes, *place, 0.3, 0, 4.0, half)
        size = float(np.linalg.norm(true))
        if abs(size - 0.3) > 0.05:  # a stretch ends at a point, half a piece off
            assert np.isfinite(far) == (size < 0.3)
        if half == 0.0:
            assert is_near == np.isfinite(far)
        if np.isfinite(far) and half == 0.0:
            assert far == pytest.approx(size, abs=1e-3)
            assert np.hypot(x, y) == pytest.approx(far)
            assert np.hypot(*(np.array([x, y]) - true)) < 2e-3 or size > 0.18


def test_places_far_outside_are_near_nothing() -> None:
    axes = axes_of(zigzag()[0])
    assert not are_near(axes, np.array([[-50.0, 1.0], [1.0, 80.0], [40.0, -40.0]]), 0.42).any()
