"""A lumen that meets the part's face at a slant is seen and measured to its end."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest

from design.network import VesselNetwork
from registration.alignment import Fit
from registration.alignment.distance import ModelSurface
from registration.measuring.gauging import VesselTrace, trace_vessels, with_mouths
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
STEEP = VesselNetwork.from_segments(
    np.array([[0.0, 0.6, 1.0], [4.4, 5.0, 1.0]]), np.array([[0, 1]]), np.array([0.4]),
    np.array([4]), np.zeros(1),
)  # fmt: skip
"""One at 45 degrees."""


def traced(
    low: float, high: float, plug_mm: float = 0.0, neck: float = 0.0,
    network: VesselNetwork = SLANTED,
) -> VesselTrace:  # fmt: skip
    """The block with its vessel in a field from x = `low` to `high`; gel in its last `plug_mm`.

    Its first 0.5 mm are narrower by `neck` all round, mm.
    """
    axes = [np.arange(a, b, VOXEL) for a, b in ((low, high), (-0.3, 5.3), (-0.3, 2.3))]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    points = np.stack([x, y, z], axis=-1)
    lumen = lumen_distance(network, points)
    ((ends, _),) = network.polylines()
    way = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    lumen = lumen + neck * ((points - ends[0]) @ way < 0.5)
    if plug_mm:
        lumen = np.where(x > BLOCK[0] - plug_mm, 1.0, lumen)
    gel = np.minimum(np.minimum(points, BLOCK - points).min(axis=-1), lumen)
    values = np.clip(0.5 + gel / (6 * VOXEL), 0, 1).astype(np.float32)
    origin = np.array([axis[0] for axis in axes])
    field = GelField(values, 0.5, 1.0, np.full(3, VOXEL), origin, blur_mm=0.0)
    surface, outward, seen = surface_mesh(field, None, 0.3)
    found = Segmentation(field, surface, outward, seen, 9.0, None)
    part = ModelSurface.of(solid(manifold3d.Manifold.cube(tuple(BLOCK)) - lumens(network)))
    here = Fit(np.eye(3), np.zeros(3), np.ones(3), np.zeros(3))
    (trace,) = with_mouths(trace_vessels(network, found, here, 0.1, part), found, here, part)
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


@pytest.mark.parametrize("network", [SLANTED, STEEP])
def test_a_neck_in_a_mouth_is_measured_by_the_wall_that_lies_in_the_gel(network):
    found = traced(-0.3, 5.3, neck=0.15, network=network)
    whole = found.counted & found.sections.closed_outline
    cut = found.counted & ~found.sections.closed_outline
    necked = found.counted & (found.along < 0.4)
    assert found.along[necked].min() < 0.26  # the first whole section lies at 0.35, and at 0.55
    assert found.diameter[necked] == pytest.approx(0.5, abs=0.03)
    assert found.diameter[cut & (found.along > 1)] == pytest.approx(0.8, abs=0.03)
    assert found.diameter[whole & (found.along > 1)] == pytest.approx(0.8, abs=0.02)
    assert cut.any() or network is SLANTED
    assert (found.sections.noise[cut] > found.sections.noise[whole].min()).all()
