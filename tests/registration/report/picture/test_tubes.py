"""Ray caster of rounded tubes, against rows of spheres in plain arithmetic."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from registration.report.picture.tubes import draw_tubes
from tests.slower import examples

SIZE = 24
Piece = tuple[NDArray[np.float64], NDArray[np.float64], float, float]

coordinate = st.floats(-2.0, SIZE + 2.0)
point = st.tuples(coordinate, coordinate, st.floats(-20.0, 20.0))
radius = st.floats(0.3, 9.0)


def naive_depth(
    a: NDArray[np.float64], b: NDArray[np.float64], ra: float, rb: float
) -> NDArray[np.float64]:
    """Front of the hull of spheres, by trying 4,000 of them at each pixel."""
    t = np.linspace(0.0, 1.0, 4001)
    centre, r = a + t[:, None] * (b - a), ra + t * (rb - ra)
    y, x = np.mgrid[:SIZE, :SIZE]
    left = r**2 - (x[:, :, None] - centre[:, 0]) ** 2 - (y[:, :, None] - centre[:, 1]) ** 2
    front = np.where(left >= 0.0, centre[:, 2] + np.sqrt(np.maximum(left, 0.0)), -np.inf)
    found: NDArray[np.float64] = front.max(axis=2)
    return found


def drawn(pieces: Sequence[Piece]) -> Any:
    start, end = np.array([p[0] for p in pieces]), np.array([p[1] for p in pieces])
    ra, rb = np.array([p[2] for p in pieces]), np.array([p[3] for p in pieces])
    return draw_tubes(start, end, ra, rb, SIZE, SIZE)


@settings(max_examples=examples(60), deadline=None)
@given(point, point, radius, radius)
def test_depth_is_that_of_a_row_of_spheres(
    a: tuple[float, float, float], b: tuple[float, float, float], ra: float, rb: float
) -> None:
    start, end = np.array(a), np.array(b)
    depth, piece, _ = drawn([(start, end, ra, rb)])
    want = naive_depth(start, end, ra, rb)
    assert np.array_equal(piece >= 0, np.isfinite(depth))
    both = np.isfinite(want) & np.isfinite(depth)
    # On the rim a pixel may be in for the one and out for the other; spheres see a little less.
    assert (np.isfinite(want) != np.isfinite(depth)).sum() <= 0.06 * SIZE * SIZE
    grazing = np.abs(depth[both] - want[both]) > 0.05
    assert grazing.mean() <= 0.06 if both.any() else True
    assert (depth[both] >= want[both] - 1e-6).all()
