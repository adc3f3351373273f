import numpy as np
import pytest
from numpy.typing import NDArray

from registration.report.simplify import (
    simplify,
)

from .sample import deviation_surface


def volume(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> float:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def test_shape_and_values_are_kept_to_the_cell() -> None:
    surface = deviation_surface(0.1)
    shown = simplify(surface, len(surface.surface.faces) // 3)
    before, after = (volume(s.surface.vertices, s.surface.faces) for s in (surface, shown))
    assert before > 0
    # The mean of points on a curved wall lies a little inside it.
    assert after == pytest.approx(before, rel=0.05)
    far = shown.cell_mm * np.sqrt(3.0)
    for k in range(0, len(shown.surface.vertices), 97):
        near = np.linalg.norm(surface.surface.vertices - shown.surface.vertices[k], axis=1)
        assert near.min() < far
    assert shown.scalar is not None
    assert np.nanmax(shown.scalar) <= np.nanmax(surface.scalar)  # type: ignore[arg-type]
