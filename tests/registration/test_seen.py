"""Surface points of an OCT scan that count as seen."""

from __future__ import annotations

import numpy as np
import pytest

from registration.segmentation.mesh import surface_mesh
from registration.segmentation.volume import GelField, Strength

VOXELS = 60


@pytest.mark.parametrize(("over", "seen"), [(3, True), (50, False)])
def test_a_wall_is_seen_and_gel_that_slowly_fades_is_not(over: int, seen: bool) -> None:
    fades = np.clip(0.5 - (np.arange(VOXELS) - 29.7) / over, 0, 1).astype(np.float32)
    values = np.repeat(np.repeat(fades[:, None, None], VOXELS, 1), VOXELS, 2)
    size = np.full(3, 0.03)
    field = GelField(values, 0.5, 1.0, size, np.zeros(3), 0.03)
    bright = Strength(np.full_like(values, 100.0), 1.0)
    mesh = surface_mesh(field, bright, 0.1)
    within = (np.abs(mesh.vertices[:, :2] - 0.9) < 0.7).all(axis=1)
    assert (mesh.seen[within] == seen).all()
