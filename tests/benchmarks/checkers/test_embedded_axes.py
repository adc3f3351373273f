"""Checker of embedded prints: assigns each place to the nearest vessel axis."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.checkers.embedded_ink import STEP_MM, read_axes
from tests.benchmarks.checkers.test_embedded import network


def test_where_axes_cross_each_place_belongs_to_its_own(tmp_path: Path) -> None:
    # The other axis has a dense point 12 µm away, the own one's nearest are 20 µm off.
    own = [(0, 0, 0), (25 * STEP_MM, 0, 0)]
    x = 10.5 * STEP_MM
    other = [(x, -25 * STEP_MM, 0.012), (x, 25 * STEP_MM, 0.012)]
    axes = read_axes(network(tmp_path / "network.csv", [(own, (0, 1)), (other, (2, 3))]))
    gap, vessel, arc, _ = axes.nearest(np.array([[x, 0.0, 0.0], [x, 0.0, 0.012]]))
    assert vessel.tolist() == [0, 1]
    np.testing.assert_allclose(gap, 0, atol=1e-9)
    np.testing.assert_allclose(arc, [x, 25 * STEP_MM])
