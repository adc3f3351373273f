"""Simulated scanners: signal physics, true pose, reproducibility."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from gcode.deposit.lay import Deposit, Laid
from gcode.deposit.written import Strands
from kernels.arrays import FloatArray
from sim.devices.recorded_ink import InkSource
from sim.devices.scanner.defects import Defect, with_defects
from sim.devices.scanner.microct import MicroCtOptions, simulate_microct
from sim.devices.scanner.oct import NOISE_COUNTS, OctField, OctOptions, live_scan, simulate_oct
from sim.devices.scanner.placing import Placing
from sim.errors import ScannerError

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
        (lambda: Defect("bulge", AXIS, RADIUS, 3.0), "length_mm"),
        (lambda: Defect("missing", AXIS[:1], RADIUS), "two or more"),
        (lambda: Defect("missing", AXIS, 0.0), "radius_mm"),
        (lambda: Defect("stenosis", AXIS, RADIUS, 3.0, 1.0, left=1.0), "left"),
        (lambda: with_defects(bored(), [Defect("missing", AXIS + 50, 0.3)]), "outside"),
    ],
)
def test_impossible_options_and_defects_are_refused(build: object, reason: str) -> None:
    with pytest.raises(ScannerError, match=reason):
        build()  # type: ignore[operator]


# Planted print defects: position and size, counted in voxels.

EDGE = 0.025
RADIUS = 0.3
AXIS = np.array([[0.0, 1.0, 1.0], [6.0, 1.0, 1.0]])


def bored() -> Deposit:
    """A bar of gel, 6 × 2 × 2 mm, with a lumen along x."""
    z, y, _ = np.meshgrid(*(EDGE * np.arange(n) for n in (81, 81, 241)), indexing="ij")
    away = np.hypot(y - 1.0, z - 1.0) - RADIUS
    volume = np.round(255 * np.clip(0.5 + away / EDGE, 0, 1)).astype(np.uint8)
    return Deposit(volume, np.zeros(3), EDGE, "layered", 1.0, 0.0)


def free_area(deposit: Deposit, x: float) -> float:
    """Of the lumen across x, mm²."""
    plane = deposit.volume[:, :, round(x / EDGE)]
    return float((1 - plane / 255.0).sum() * EDGE**2)


def diameter(deposit: Deposit, x: float) -> float:
    return float(np.sqrt(4 / np.pi * free_area(deposit, x)))


def test_bulge_stands_back_by_its_height_and_fades_out() -> None:
    found = with_defects(bored(), [Defect("bulge", AXIS, RADIUS, 3.0, 1.2, 0.06)])
    assert diameter(found, 3.0) == pytest.approx(2 * (RADIUS + 0.06), abs=0.003)
    sigma = 1.2 / 4
    assert diameter(found, 3.0 + sigma) == pytest.approx(
        2 * (RADIUS + 0.06 * np.exp(-0.5)), abs=0.003
    )
    assert diameter(found, 5.0) == pytest.approx(2 * RADIUS, abs=0.002)


def test_occlusion_is_as_long_as_ordered_and_beside_it_nothing_changes() -> None:
    found = with_defects(bored(), [Defect("occlusion", AXIS, 1.2 * RADIUS, 3.0, 0.8)])
    along = 1 - found.volume[round(1 / EDGE), round(1 / EDGE)] / 255.0
    assert (1 - along).sum() * EDGE == pytest.approx(0.8, abs=1e-3)
    np.testing.assert_array_equal(found.volume[..., :90], bored().volume[..., :90])


def test_leak_is_a_round_hole_from_the_lumen_outward() -> None:
    way = np.array([[2.0, 1.0, 1.0], [2.0, 1.0, 2.5]])
    found = with_defects(bored(), [Defect("leak", way, 0.12)])
    plane = 1 - found.volume[round(1.7 / EDGE)] / 255.0
    assert plane.sum() * EDGE**2 == pytest.approx(np.pi * 0.12**2, rel=0.02)
    below = 1 - found.volume[round(0.4 / EDGE)] / 255.0
    assert below.sum() == 0


def test_in_sacrificial_ink_gel_and_lumen_change_places() -> None:
    gel = bored()
    ink = replace(gel, volume=255 - gel.volume, style="embedded")
    defects = [
        Defect("occlusion", AXIS, 1.2 * RADIUS, 3.0, 0.8),
        Defect("bulge", AXIS, RADIUS, 1.2, 0.8, 0.05),
    ]
    in_gel, in_ink = with_defects(gel, defects), with_defects(ink, defects)
    np.testing.assert_array_equal(in_ink.volume, 255 - in_gel.volume)


# Simulated OCT of a field in place: a part of it is seen as in a scan of all of it.

LOW, HIGH = np.array([1.0, 0.5, 0.3]), np.array([2.5, 1.5, 0.9])


@pytest.fixture(scope="module")
def field() -> OctField:
    source = InkSource(printer="generic_marlin", syringe="hamilton_1ml", ink="collagen_fresh")
    return OctField(low_mm=(0, 0, 0), high_mm=(3, 2, 1.2), looks=64, laid=source)


def voxels(scan, places):
    """Brightness at places of the printer, mm."""
    at = places @ scan.pose_truth[:3, :3].T + scan.pose_truth[:3, 3]
    dz, dy, dx = scan.voxel_mm
    index = np.floor(at / [dx, dy, dz / scan.refractive_index]).astype(int)
    return scan.volume[index[:, 2], index[:, 1], index[:, 0]].astype(float)


@pytest.fixture(scope="module")
def ink() -> Laid:
    """Filaments of 0.3 mm across the field, in a bath."""
    y = np.array([0.4, 1.0, 1.6])
    start = np.stack([np.full(3, -1.0), y, np.full(3, 0.6)], axis=1)
    end = start + [5.0, 0, 0]
    dose = np.full(3, 5.0 * np.pi / 4 * 0.3**2)
    return Laid(Strands.dosed(start, end, dose, np.arange(3), np.arange(3) + 1), None)


def test_a_part_of_the_field_is_seen_as_in_a_scan_of_all_of_it(ink, field):
    all_of_it, part = (live_scan(ink, field, 5, one) for one in (None, (LOW, HIGH)))
    assert part.volume.size < 0.3 * all_of_it.volume.size
    rng = np.random.default_rng(1)
    places = rng.uniform(LOW + 0.05, HIGH - 0.05, (4000, 3))
    whole, seen = (voxels(one, places) for one in (all_of_it, part))
    inside = np.hypot(places[:, 1] - 1.0, places[:, 2] - 0.6) < 0.1
    assert whole[inside].mean() > 20 * whole[~inside & (places[:, 2] > 0.8)].mean()
    assert np.median(seen[inside] / whole[inside]) == pytest.approx(1.0, abs=0.05)
    assert np.corrcoef(np.log(whole + 1), np.log(seen + 1))[0, 1] > 0.95


def test_a_region_beside_the_field_is_refused(ink, field):
    with pytest.raises(ScannerError, match="lies outside the OCT's field"):
        live_scan(ink, field, 5, (LOW + 5, HIGH + 5))


def test_stenosis_leaves_its_share_of_the_diameter() -> None:
    found = with_defects(bored(), [Defect("stenosis", AXIS, RADIUS, 3.0, 1.6, left=0.5)])
    assert diameter(found, 3.0) == pytest.approx(RADIUS, abs=0.003)
    assert diameter(found, 5.0) == pytest.approx(2 * RADIUS, abs=0.003)


def test_roll_off_falls_to_one_over_e_at_its_depth() -> None:
    options = replace(OCT, attenuation_mm=0.0, reflection=0.0, roll_off_mm=2.0, signal_db=30.0)
    found = simulate_oct(slab(), options, seed=1).volume
    k = round(2.0 / dz(OCT))
    deep = found[k - 1 : k + 2, 20:40, 20:40].mean() - NOISE_COUNTS
    assert deep / (NOISE_COUNTS * 10**3) == pytest.approx(np.exp(-1), rel=0.05)
