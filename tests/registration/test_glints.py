"""Air along a drained lumen outshines what the walls of the part send back."""

from __future__ import annotations

import numpy as np
import pytest

from registration.segmentation.evidence import GLARE, find_glints


@pytest.mark.parametrize("drained", [0.005, 0.2])
def test_air_over_a_fifth_of_the_scan_does_not_pass_for_its_walls(drained: float) -> None:
    rng = np.random.default_rng(2)
    share = rng.exponential(1.0, (40, 80, 80)).astype(np.float32)
    share[5] = 4 * rng.exponential(1.0, (80, 80))  # a face across the light
    rows = round(80 * drained)
    share[12, :rows] = 300.0
    found = find_glints(share, np.full(3, 0.02), np.zeros(3), True)
    air = np.isclose(found.place[:, 2], 12 * 0.02) & (found.share > 200)
    assert np.count_nonzero(air) == rows * 80
    assert (found.share[air] > GLARE * found.usual).all()
