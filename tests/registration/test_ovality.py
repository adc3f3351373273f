"""Ovality of lumens: found as made, whatever single sections scatter."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from design.network import VesselNetwork
from registration.alignment import Fit
from registration.alignment.uncertainty import ScanErrors, section_errors
from registration.measuring.gauging import trace_vessels
from registration.measuring.gauging.vessels import Oval, ovality
from registration.segmentation import GelField, Segmentation
from registration.segmentation.mesh import surface_mesh

VOXEL, LENGTH, RADIUS = 0.025, 3.0, 0.2
LINE = VesselNetwork.from_segments(
    np.array([[0.0, 0.0, 0.0], [LENGTH, 0.0, 0.0]]), np.array([[0, 1]]), np.array([RADIUS]),
    np.array([4]), np.zeros(1),
)  # fmt: skip


def measured(ratio: float, length: float = LENGTH, noise: float = 0.0) -> Oval:
    """A lumen with this ratio of its axes and a circle's area, over a length from its start."""
    x, side = np.arange(-0.3, LENGTH + 0.3, VOXEL), np.arange(-0.6, 0.6, VOXEL)
    z, y, x = np.meshgrid(side, side, x, indexing="ij")
    long = np.where(x < length, np.sqrt(ratio), 1.0)
    scaled = np.hypot(y / long, z * long)
    gel = (scaled - RADIUS) * RADIUS / np.maximum(np.hypot(y / long**2, z * long**2), 1e-6)
    rough = gaussian_filter(np.random.default_rng(4).normal(size=gel.shape), 1.0)
    gel = gel + noise * rough / rough.std()
    values = np.clip(0.5 + gel / 0.15, 0, 1).astype(np.float32)
    origin = np.array([-0.3, -0.6, -0.6])
    field = GelField(values, 0.5, 1.0, np.full(3, VOXEL), origin, blur_mm=VOXEL)
    surface, outward, seen = surface_mesh(field, None, 0.3)
    here = Fit(np.eye(3), np.zeros(3), np.ones(3), np.zeros(3))
    found = Segmentation(field, surface, outward, seen, 10.0, None)
    (trace,) = trace_vessels(LINE, found, here, 0.1)
    errors, counted = ScanErrors.of_blur(VOXEL), trace.counted
    own = section_errors(
        errors, trace.diameter[counted], trace.sections.noise[counted],
        trace.planes.across[counted], trace.spacing,
    )  # fmt: skip
    return ovality(trace, own, errors)


@pytest.mark.parametrize("ratio", [1.2, 2.0])
def test_the_widths_differ_as_made(ratio: float) -> None:
    found = measured(ratio)
    made = 2e3 * RADIUS * (np.sqrt(ratio) - np.sqrt(1 / ratio))
    assert found.widths_um == pytest.approx(made, abs=0.1 * made)


def test_a_short_oval_is_found_where_it_is() -> None:
    found = measured(2.0, length=0.9)
    assert found.widths_um > 200.0
    assert found.at_mm < 0.9


def test_noise_of_a_round_lumen_is_no_ovality() -> None:
    found = measured(1.0, noise=0.012)
    assert found.widths_um < 40.0
    assert 5.0 < found.u_um < 40.0
