"""Vessel sections, clearances and deviations, on known shapes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from design.network import VesselNetwork
from registration.alignment import Fit
from registration.alignment.uncertainty import ScanErrors, section_errors
from registration.measuring.gauging import find_changes, trace_vessels
from registration.measuring.gauging.sections import Planes, cut_sections, oval_conductance
from registration.measuring.gauging.vessels import Oval, ovality
from registration.segmentation import GelField, Segmentation
from registration.segmentation.mesh import surface_mesh
from tests.registration.parts import lumen_distance

VOXEL = np.array([0.05, 0.05, 0.04])


def bore(radius: float, centre_y: float = 1.5, plug: tuple[float, float] = (9, 9)) -> GelField:
    """Gel with a straight lumen along x at (y, z) = (centre_y, 1.5); full between the plug's x."""
    z, y, x = np.meshgrid(*(np.arange(n) for n in (75, 60, 60)), indexing="ij")
    away = np.hypot(y * VOXEL[1] - centre_y, z * VOXEL[2] - 1.5) - radius
    gel = np.where((x * VOXEL[0] > plug[0]) & (x * VOXEL[0] < plug[1]), 1.0, away)
    values = np.clip(0.5 + gel / 0.2, 0, 1).astype(np.float32)
    return GelField(values, 0.5, 1.0, VOXEL, np.zeros(3), blur_mm=0.0)


def planes(radius: float, xs: list[float]) -> Planes:
    n = len(xs)
    centre = np.array([[x, 1.5, 1.5] for x in xs])
    across = np.broadcast_to(np.array([[0.0, 1, 0], [0, 0, 1]]), (n, 2, 3)).copy()
    return Planes(centre, across, np.full(n, radius))


@pytest.mark.parametrize("radius", [0.2, 0.35, 0.5])
def test_diameter_of_a_bore_is_right_to_two_micrometres(radius: float) -> None:
    found = cut_sections(bore(radius), planes(radius, [0.8, 1.5, 2.1]))
    assert found.closed_outline.all()
    np.testing.assert_allclose(found.diameter, 2 * radius, atol=0.002)
    np.testing.assert_allclose(found.offset, 0, atol=0.002)


def test_plug_is_closed_and_beside_it_open() -> None:
    found = cut_sections(bore(0.3, plug=(1.2, 1.8)), planes(0.3, [0.8, 1.5, 2.2]))
    np.testing.assert_array_equal(found.open, [True, False, True])
    assert found.diameter[1] == 0


def test_known_blur_is_undone_to_first_order() -> None:
    radius, blur = 0.3, 0.08
    field = bore(radius - blur**2 / (2 * radius))
    blurred = GelField(field.values, 0.5, 1.0, VOXEL, np.zeros(3), blur_mm=blur)
    found = cut_sections(blurred, planes(radius, [1.5]))
    assert found.diameter[0] == pytest.approx(2 * radius, abs=0.004)


def test_beside_a_sibling_at_a_narrow_angle_no_diameter_is_measured() -> None:
    """Two vessels part at 9 degrees: until there is gel between them neither has a wall there."""
    nodes = np.array([[0.0, 0, 0], [2, 0, 0], [8, 0.48, 0], [8, -0.48, 0]])
    network = VesselNetwork.from_segments(
        nodes, np.array([[0, 1], [1, 2], [1, 3]]), np.array([0.3, 0.25, 0.25]), np.zeros(3),
        np.zeros(3),
    )  # fmt: skip
    low = np.array([-0.5, -1.5, -0.9])
    axes = [np.arange(a, b, 0.05) for a, b in zip(low, (8.5, 1.5, 0.9), strict=True)]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    away = lumen_distance(network, np.stack([x, y, z], axis=-1))
    values = np.clip(0.5 + away / 0.3, 0, 1).astype(np.float32)
    field = GelField(values, 0.5, 1.0, np.full(3, 0.05), low, blur_mm=0.0)
    surface, outward, seen = surface_mesh(field, None, 0.3)
    found = Segmentation(field, surface, outward, seen, 9.0, None)
    here = Fit(np.eye(3), np.zeros(3), np.ones(3), np.zeros(3))
    trace = trace_vessels(network, found, here, 0.1)[1]
    # The axes are as far apart as the two lumens are wide only after 6 · 0.25 / 0.48 mm.
    assert trace.along[trace.counted].min() > 6 * 0.25 / 0.48
    np.testing.assert_allclose(trace.diameter[trace.counted], 0.5, atol=0.01)
    assert find_changes(trace_vessels(network, found, here, 0.1), 1.0) == []


def test_an_oval_conducts_less_than_a_circle_of_its_area() -> None:
    a, b = 0.34, 0.20  # semi-axes: q is as a³ b³ / (a² + b²), of the circle as (ab)² / 2
    ratio = 2 * a * b / (a * a + b * b)
    found = oval_conductance(np.array([a / b, 1.0, np.nan]))
    np.testing.assert_allclose(found, [ratio, 1.0, 1.0])


# Ovality of lumens: found as made, whatever single sections scatter.

VOXEL_OVALITY, LENGTH, RADIUS = 0.025, 3.0, 0.2
LINE = VesselNetwork.from_segments(
    np.array([[0.0, 0.0, 0.0], [LENGTH, 0.0, 0.0]]), np.array([[0, 1]]), np.array([RADIUS]),
    np.array([4]), np.zeros(1),
)  # fmt: skip


def measured(ratio: float, length: float = LENGTH, noise: float = 0.0) -> Oval:
    """A lumen with this ratio of its axes and a circle's area, over a length from its start."""
    x, side = np.arange(-0.3, LENGTH + 0.3, VOXEL_OVALITY), np.arange(-0.6, 0.6, VOXEL_OVALITY)
    z, y, x = np.meshgrid(side, side, x, indexing="ij")
    long = np.where(x < length, np.sqrt(ratio), 1.0)
    scaled = np.hypot(y / long, z * long)
    gel = (scaled - RADIUS) * RADIUS / np.maximum(np.hypot(y / long**2, z * long**2), 1e-6)
    rough = gaussian_filter(np.random.default_rng(4).normal(size=gel.shape), 1.0)
    gel = gel + noise * rough / rough.std()
    values = np.clip(0.5 + gel / 0.15, 0, 1).astype(np.float32)
    origin = np.array([-0.3, -0.6, -0.6])
    field = GelField(values, 0.5, 1.0, np.full(3, VOXEL_OVALITY), origin, blur_mm=VOXEL_OVALITY)
    surface, outward, seen = surface_mesh(field, None, 0.3)
    here = Fit(np.eye(3), np.zeros(3), np.ones(3), np.zeros(3))
    found = Segmentation(field, surface, outward, seen, 10.0, None)
    (trace,) = trace_vessels(LINE, found, here, 0.1)
    errors, counted = ScanErrors.of_blur(VOXEL_OVALITY), trace.counted
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
