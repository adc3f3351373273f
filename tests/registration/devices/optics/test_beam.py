"""Refraction of the OCT beam: Snell's law, inverse, bounds, resampled scan."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from registration import Scan
from registration.devices.optics import (
    Beam,
    OctCalibration,
    find_surface,
    refract,
    refraction_bound,
    undistort,
)
from registration.errors import RegistrationError, SegmentationError
from tests.registration.devices.optics.optical import FAULT, tilted
from tests.slower import examples, first_of


@given(
    angle=st.floats(0, 1.4), azimuth=st.floats(0, 6.3), index=st.floats(1.0, 2.0),
    lean=st.floats(-0.5, 0.5),
)  # fmt: skip
@settings(max_examples=examples(60), deadline=None)
def test_refraction_keeps_to_snells_law(angle, azimuth, index, lean):
    normal = np.array([math.sin(lean), 0.0, -math.cos(lean)])
    aside = np.array([math.cos(lean), 0.0, math.sin(lean)])
    third = np.cross(normal, aside)
    across = math.cos(azimuth) * aside + math.sin(azimuth) * third
    direction = -math.cos(angle) * normal + math.sin(angle) * across
    bent = refract(direction[None], normal[None], index)[0]
    assert np.linalg.norm(bent) == pytest.approx(1.0)
    assert index * np.linalg.norm(np.cross(bent, normal)) == pytest.approx(math.sin(angle))
    assert np.cross(bent, direction) @ normal == pytest.approx(0.0, abs=1e-9)


def test_the_bound_is_the_shift_of_a_straight_ray() -> None:
    aside, up = refraction_bound(10.0, 2.0, 1.34)
    surface = tilted(0.0, math.tan(math.radians(10.0)), 0.0)
    beam = Beam(OctCalibration(), np.zeros(2), 1.34, surface)
    (point,) = beam.to_true(np.array([[0.0, 0.0, 2.0 * 1.34]]))
    assert abs(point[0]) == pytest.approx(aside, rel=1e-6)
    assert 2.0 - point[2] == pytest.approx(up, rel=1e-6)
    assert aside > 0.08
    for tilt, index in ((-1.0, 1.3), (90.0, 1.3), (5.0, 0.9)):
        with pytest.raises(RegistrationError):
            refraction_bound(tilt, 1.0, index)


def test_what_is_too_steep_is_refused() -> None:
    steep = Beam(OctCalibration(fan_per_mm=(0.1, 0.0)), np.zeros(2), 1.0)
    with pytest.raises(RegistrationError, match="slope"):
        steep.to_true(np.array([[5.0, 0.0, 0.0]]))
    beam = Beam(OctCalibration(), np.zeros(2), 1.34, tilted(1.0, 0.9, 0.0))
    with pytest.raises(RegistrationError, match="steeper"):
        beam.to_true(np.array([[1.0, 1.0, 3.0]]))


@cache
def bead_scan(surface_tilt: float) -> tuple[Scan, np.ndarray]:
    """Bright beads at known true places in gel (index 1.34) below a tilted surface under air."""
    shape, voxel = (160, 60, 70), (0.02, 0.04, 0.04)
    surface = tilted(0.6, surface_tilt, 0.0)
    empty = Scan(
        np.zeros(shape, np.float32), voxel, 1.34, True, "db", "oct", True, Path("beads.oct")
    )
    beam = Beam.of(empty, FAULT, surface)
    z, y, x = (np.arange(n) * s for n, s in zip(shape, voxel, strict=True))
    gz, gy, gx = np.meshgrid(z, y, x, indexing="ij")
    true = beam.to_true(np.stack([gx, gy, gz], axis=-1).reshape(-1, 3))
    beads = np.array([[0.7, 0.7, 1.2], [2.1, 0.8, 1.5], [0.8, 1.7, 1.7], [2.0, 1.6, 1.3]])
    level = np.where(gz > surface.depth_mm(gx, gy), 12.0, 0.0)
    for bead in beads:
        away = np.sum((true - bead) ** 2, axis=1).reshape(shape)
        level = level + 30 * np.exp(-0.5 * away / 0.06**2)
    noise = np.random.default_rng(0).normal(0, 0.5, shape)
    return replace(empty, volume=(level + noise).astype(np.float32)), beads


def centre_of(scan: Scan, near: np.ndarray) -> np.ndarray:
    voxel = np.array(scan.voxel_mm)
    at = np.round(near[::-1] / voxel).astype(int)
    half = np.round(0.2 / voxel).astype(int)
    box = tuple(slice(a - h, a + h + 1) for a, h in zip(at, half, strict=True))
    weight = np.maximum(scan.volume[box].astype(float) - 20.0, 0)
    places = np.indices(weight.shape).reshape(3, -1) @ weight.ravel() / weight.sum()
    return np.asarray(((places + at - half) * voxel)[::-1])


@pytest.mark.parametrize("tilt", first_of([0.12, 0.0]))
def test_beads_come_back_to_their_places(tilt: float) -> None:
    scan, beads = bead_scan(tilt)
    surface = find_surface(scan)
    assert surface.depth_mm(np.array([1.4]), np.array([1.2]))[0] == pytest.approx(
        0.6 + tilt * 1.4, abs=0.02
    )
    assert surface.tilt_deg == pytest.approx(math.degrees(math.atan(tilt)), abs=0.5)
    straight = undistort(scan, FAULT, surface)
    assert not straight.optical_depth
    assert "undone" in straight.notes[-1]
    # Where the grid begins is free, so distances between beads are what must be true.
    lowest = (
        Beam.of(scan, FAULT, surface)
        .to_true(np.array([[x, y, z] for x in (0, 2.76) for y in (0, 2.36) for z in (0, 3.18)]))
        .min(axis=0)
    )
    found = np.array([centre_of(straight, bead - lowest) for bead in beads])
    for i in range(4):
        for j in range(i):
            expected = np.linalg.norm(beads[i] - beads[j])
            assert np.linalg.norm(found[i] - found[j]) == pytest.approx(expected, abs=0.006)


def test_a_view_full_of_liquid_shows_no_surface_under_air() -> None:
    scan, _ = bead_scan(0.0)
    full = replace(scan, volume=np.full_like(scan.volume, 12.0))
    with pytest.raises(SegmentationError, match="--air-above"):
        find_surface(full)


@given(seed=st.integers(0, 10**6), air=st.booleans(), index=st.floats(1.0, 1.6))
@settings(max_examples=examples(40), deadline=None)
def test_to_scan_is_the_inverse_of_to_true(seed: int, air: bool, index: float) -> None:
    rng = np.random.default_rng(seed)
    surface = tilted(1.0, *rng.uniform(-0.15, 0.15, 2)) if air else None
    beam = Beam(FAULT, np.array([2.5, 3.0]), index, surface)
    points = rng.uniform(0, 1, (50, 3)) * [5.0, 6.0, 4.0]
    np.testing.assert_allclose(beam.to_scan(beam.to_true(points)), points, atol=2e-5)


def test_above_the_surface_depth_is_not_divided() -> None:
    beam = Beam(OctCalibration(), np.zeros(2), 1.34, tilted(1.0, 0.0, 0.0))
    points = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 1.0], [0.0, 0.0, 2.34]])
    np.testing.assert_allclose(beam.to_true(points)[:, 2], [0.5, 1.0, 2.0])
