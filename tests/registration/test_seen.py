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
    bright = Strength(np.full_like(values, 100.0), 1.0, values.astype(np.float16))
    surface, _, found = surface_mesh(field, bright, 0.1)
    within = (np.abs(surface.vertices[:, :2] - 0.9) < 0.7).all(axis=1)
    assert (found[within] == seen).all()


@pytest.mark.parametrize(("liquid", "seen"), [(0.4, True), (1.3, False)])
def test_a_wall_beside_bright_liquid_is_seen_where_raw_light_steps(
    liquid: float, seen: bool
) -> None:
    """Liquid that sends back 0.4 of what gel does: more comes back only under more light."""
    x = np.arange(VOXELS)
    values = np.repeat(np.repeat((x < 29.7)[None, None].astype(np.float32), VOXELS, 0), VOXELS, 1)
    speckle = np.random.default_rng(3).exponential(1.0, values.shape)
    signal = (np.where(values > 0.5, 1.0, liquid) * speckle).astype(np.float32)
    field = GelField(values, 0.5, 1.0, np.full(3, 0.03), np.zeros(3), 0.03)
    surface, _, found = surface_mesh(
        field, Strength(signal, 0.01, signal.astype(np.float16), 0.4), 0.1
    )
    within = (np.abs(surface.vertices[:, 1:] - 0.9) < 0.7).all(axis=1)
    assert (found[within] == seen).mean() > 0.97
