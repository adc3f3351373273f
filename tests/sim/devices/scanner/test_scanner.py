"""Simulated scanners: signal physics, true pose, reproducibility."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
import pytest

from kernels.arrays import FloatArray
from sim.devices.scanner import MicroCtOptions, OctOptions, Placing, simulate_microct, simulate_oct
from sim.devices.scanner.oct import NOISE_COUNTS
from sim.errors import ScannerError
from sim.gcode.deposit.lay import Deposit

STILL = Placing(tilt_deg=0, rotation_deg=0, shift_mm=0, margin_mm=0.4, shrink=(1, 1, 1))
OCT = OctOptions(voxel_mm=(0.04, 0.04, 0.04), placing=STILL)


def slab(size: tuple[int, int, int] = (60, 40, 50)) -> Deposit:
    """A full block of 0.04 mm voxels (z, y, x) with an empty voxel all round."""
    volume = np.zeros(tuple(n + 2 for n in size), np.uint8)
    volume[1:-1, 1:-1, 1:-1] = 255
    return Deposit(volume, np.array([20.0, 30.0, 1.0]), 0.04, "layered", 0.0, 0.0)


def dz(options: OctOptions) -> float:
    return options.voxel_mm[0] / options.refractive_index


def test_same_seed_same_bytes_on_any_number_of_threads() -> None:
    threads = numba.get_num_threads()
    first = simulate_oct(slab(), OctOptions(voxel_mm=(0.04, 0.04, 0.04)), seed=5)
    numba.set_num_threads(1)
    try:
        second = simulate_oct(slab(), OctOptions(voxel_mm=(0.04, 0.04, 0.04)), seed=5)
        ct_one = simulate_microct(slab(), MicroCtOptions(), seed=5)
    finally:
        numba.set_num_threads(threads)
    np.testing.assert_array_equal(first.volume, second.volume)
    np.testing.assert_array_equal(first.pose_truth, second.pose_truth)
    np.testing.assert_array_equal(
        ct_one.volume, simulate_microct(slab(), MicroCtOptions(), 5).volume
    )


def test_gel_fades_by_beer_lambert_and_liquid_holds_the_noise_floor() -> None:
    found = simulate_oct(slab(), replace(OCT, reflection=0.0, roll_off_mm=1e3), seed=1)
    column = found.volume[:, 20:40, 20:40].mean(axis=(1, 2))
    assert column[:8].mean() == pytest.approx(NOISE_COUNTS, rel=0.05)
    lit = column[20:70] - NOISE_COUNTS
    slope = np.polyfit(np.arange(50) * dz(OCT), np.log(lit), 1)[0]
    assert slope == pytest.approx(-2 * OCT.attenuation_mm, rel=0.03)


@pytest.mark.parametrize("looks", [1, 4])
def test_speckle_contrast_is_one_over_the_root_of_the_looks(looks: int) -> None:
    options = replace(OCT, attenuation_mm=0.0, reflection=0.0, roll_off_mm=1e3, looks=looks,
                      signal_db=25.0)  # fmt: skip
    gel = simulate_oct(slab(), options, seed=1).volume[30:60, 20:40, 20:40].astype(float)
    assert gel.std() / gel.mean() == pytest.approx(looks**-0.5, rel=0.03)
    assert gel.mean() == pytest.approx(NOISE_COUNTS * (1 + 10**2.5), rel=0.02)


def test_depth_is_optical_and_points_down() -> None:
    found = simulate_oct(slab(), OCT, seed=1)
    assert found.optical_depth
    assert found.depth_down
    thick = (found.volume[:, 20:40, 20:40].mean(axis=(1, 2)) > 5 * NOISE_COUNTS).sum()
    assert thick * dz(OCT) == pytest.approx(60 * 0.04, abs=3 * dz(OCT))
    assert found.pose_truth[2, 2] == pytest.approx(-1)
    assert np.linalg.det(found.pose_truth[:3, :3]) == pytest.approx(1)


def centroid(found: FloatArray, voxel: tuple[float, float, float]) -> FloatArray:
    grid = np.meshgrid(*(np.arange(n) * v for n, v in zip(found.shape, voxel, strict=True)),
                       indexing="ij")  # fmt: skip
    return np.array([float((g * found).sum() / found.sum()) for g in grid[::-1]])


def test_truth_maps_the_part_to_where_it_is_seen() -> None:
    placing = Placing(tilt_deg=8, rotation_deg=180, shrink=(0.95, 0.97, 0.99))
    part = slab()
    for seed in (1, 2, 3):
        found = simulate_microct(part, MicroCtOptions(noise_counts=0, placing=placing), seed)
        dark = (20000.0 - found.volume) / 12000.0
        middle = part.bounds_mm.mean(axis=0)
        expected = found.pose_truth[:3, :3] @ middle + found.pose_truth[:3, 3]
        np.testing.assert_allclose(centroid(dark, found.voxel_mm), expected, atol=0.003)
        volume = dark.sum() * np.prod(found.voxel_mm)
        assert volume == pytest.approx(60 * 40 * 50 * 0.04**3 * 0.95 * 0.97 * 0.99, rel=0.01)


def test_microct_noise_has_its_spread_and_lumens_their_grey() -> None:
    found = simulate_microct(slab(), MicroCtOptions(placing=STILL), seed=1).volume.astype(float)
    assert found[:4].mean() == pytest.approx(20000, rel=0.005)
    assert found[:4].std() == pytest.approx(1500, rel=0.03)
    middle = found[12:20, 12:16, 12:18]
    assert middle.mean() == pytest.approx(8000, rel=0.02)


def test_microct_shows_ink_that_is_the_gel_bright_in_dark_liquid() -> None:
    """A FRESH part was scanned as if it were melted out: dark in bright gel (2026-11-26)."""
    options = MicroCtOptions(placing=STILL, ink="gel")
    found = simulate_microct(slab(), options, seed=1).volume.astype(float)
    assert found[:4].mean() == pytest.approx(8000, rel=0.02)
    assert found[12:20, 12:16, 12:18].mean() == pytest.approx(20000, rel=0.02)


@pytest.mark.parametrize(
    ("build", "reason"),
    [
        (lambda: OctOptions(looks=0), "looks"),
        (lambda: OctOptions(refractive_index=13.4), "refractive_index"),
        (lambda: OctOptions(signal_db=60), "signal_db"),
        (lambda: MicroCtOptions(voxel_mm=0), "voxel_mm"),
        (lambda: MicroCtOptions(gel_counts=1e6), "gel_counts"),
        (lambda: Placing(shift_mm=2.0, margin_mm=0.5), "margin_mm"),
        (lambda: Placing(shrink=(0.1, 1, 1)), "shrink"),
    ],
)
def test_impossible_options_are_refused(build: object, reason: str) -> None:
    with pytest.raises(ScannerError, match=reason):
        build()  # type: ignore[operator]
