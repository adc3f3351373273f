"""A lumen that meets the part's face at a slant is seen to its end where the field ends near it."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest

from design.network import VesselNetwork
from registration.alignment import Fit
from registration.distance import ModelSurface
from registration.gauging import VesselTrace, trace_vessels
from registration.segmentation import GelField, Segmentation
from registration.segmentation.mesh import surface_mesh
from tests.registration.parts import lumen_distance, lumens, solid

BLOCK = np.array([5.0, 5.0, 2.0])
VOXEL = 0.04
SLANTED = VesselNetwork.from_segments(
    np.array([[0.0, 2.5, 1.0], [5.0, 4.5, 1.0]]), np.array([[0, 1]]), np.array([0.4]),
    np.array([4]), np.zeros(1),
)  # fmt: skip
"""One vessel, at 22 degrees to the normal of the faces that it opens in."""


def traced(low: float, high: float, plug_mm: float = 0.0) -> VesselTrace:
    """The block with its vessel in a field from x = `low` to `high`; gel in its last `plug_mm`."""
    axes = [np.arange(a, b, VOXEL) for a, b in ((low, high), (-0.3, 5.3), (-0.3, 2.3))]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    points = np.stack([x, y, z], axis=-1)
    lumen = lumen_distance(SLANTED, points)
    if plug_mm:
        lumen = np.where(x > BLOCK[0] - plug_mm, 1.0, lumen)
    gel = np.minimum(np.minimum(points, BLOCK - points).min(axis=-1), lumen)
    values = np.clip(0.5 + gel / (6 * VOXEL), 0, 1).astype(np.float32)
    origin = np.array([axis[0] for axis in axes])
    field = GelField(values, 0.5, 1.0, np.full(3, VOXEL), origin, blur_mm=0.0)
    surface, outward, seen = surface_mesh(field, None, 0.3)
    found = Segmentation(field, surface, outward, seen, 9.0, None)
    part = ModelSurface.of(solid(manifold3d.Manifold.cube(tuple(BLOCK)) - lumens(SLANTED)))
    here = Fit(np.eye(3), np.zeros(3), np.ones(3), np.zeros(3))
    (trace,) = trace_vessels(SLANTED, found, here, 0.1, part)
    return trace


def test_no_wall_is_looked_for_where_the_design_has_none() -> None:
    found = traced(-0.1, 5.1)
    assert found.seen.all()
    assert found.sections.open.all()


@pytest.mark.parametrize(("low", "high"), [(0.5, 5.1), (-0.1, 4.5)])
def test_walls_that_lie_past_the_field_are_not_seen(low: float, high: float) -> None:
    found = traced(low, high)
    x = found.centre[:, 0]
    assert not found.seen[(x < low) | (x > high)].any()
    assert found.seen[(x > low + 0.3) & (x < high - 0.3)].all()


def test_a_plug_at_the_mouth_is_told() -> None:
    found = traced(-0.1, 5.1, plug_mm=0.5)
    assert (found.seen & ~found.sections.open).any()
