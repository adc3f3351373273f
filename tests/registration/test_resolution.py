"""Depth of a lumen's profile under blur, and the voxels that it needs."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from registration.measuring.gauging.resolution import LEAST_KEPT, kept_depth, needed_voxel_um


@pytest.mark.parametrize("blur", [2.0, 5.0, 12.0])
def test_a_blurred_disc_keeps_what_the_formula_says(blur: float) -> None:
    y, x = np.mgrid[-60:61, -60:61]
    disc = gaussian_filter((x**2 + y**2 < 10.0**2).astype(float), blur, truncate=6)
    assert disc[60, 60] == pytest.approx(float(kept_depth(np.array([10.0]), blur)[0]), abs=0.01)


def test_voxels_of_80_um_are_too_coarse_for_vessels_of_128_um() -> None:
    needed = needed_voxel_um(128.0, 0.064, (0.06, 0.08, 0.08))
    assert needed == pytest.approx(48, abs=1)
    finer = 0.064 * needed / 80
    assert kept_depth(np.array([0.064]), finer)[0] == pytest.approx(LEAST_KEPT)
    assert np.isnan(needed_voxel_um(128.0, 0.03, (0.03, 0.03, 0.03)))
