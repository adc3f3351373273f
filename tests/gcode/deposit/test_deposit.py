"""Deposit model, against areas, volumes and a slow painter."""

from itertools import pairwise

import numba
import numpy as np
import pytest

from gcode.deposit.kernels import SUPERSAMPLE, paint_filaments, paint_layers
from gcode.deposit.lay import deposit, deposit_of_heads
from gcode.deposit.written import Strands, united
from gcode.errors import DepositError
from gcode.motion.executed import ExecutedMotion
from tests.sim.motions import moved

AREA = 16.69
WIDTH, HEIGHT = 0.15, 0.06


def motion(points: list[tuple[float, float, float]], volume: list[float]) -> ExecutedMotion:
    """Blocks from point to point; ``volume`` in µL each."""
    return moved(points, volume, AREA)


def hatch(layers: int = 3, lines: int = 10, length: float = 4.0) -> ExecutedMotion:
    points = [(0.0, 0.0, 5.0)]
    volume: list[float] = []
    for layer in range(layers):
        z = (layer + 1) * HEIGHT
        for line in range(lines):
            y = 10 + (line + 0.5) * WIDTH
            points += [(10.0, y, z), (10.0 + length, y, z)]
            volume += [0.0, length * WIDTH * HEIGHT]
    return motion(points, volume)


@pytest.mark.slow
def test_hatched_layers_hold_the_written_volume() -> None:
    found = deposit(hatch(), AREA, 0.02)
    caps = 3 * 10 * np.pi * (WIDTH / 2) ** 2 * HEIGHT
    assert found.style == "layered"
    assert found.written_ul == pytest.approx(3 * 10 * 4 * WIDTH * HEIGHT)
    assert found.volume_mm3 == pytest.approx(found.written_ul + caps, rel=0.01)


def test_line_hangs_below_the_tip_and_is_area_over_height_wide() -> None:
    found = deposit(hatch(lines=1), AREA, 0.01)
    x = found.volume.shape[2] // 2
    share = found.volume[:, :, x] / 255.0
    tall = share.max(axis=1) * 0.01
    z = found.origin_mm[2] + 0.01 * np.arange(len(tall))
    assert tall.sum() == pytest.approx(3 * HEIGHT, abs=1e-3)
    assert z[tall > 0].max() <= 3 * HEIGHT + 0.005
    assert z[tall > 0].min() >= -0.005
    width = share[found.volume.shape[0] // 2].sum() * 0.01
    assert width == pytest.approx(WIDTH, abs=0.011)


@pytest.mark.parametrize("first", [HEIGHT, HEIGHT / 3])
def test_layers_of_different_heights_keep_their_lines_width(first: float) -> None:
    """Most are a third as high as the others, which hold three times as much: they don't hang."""
    heights = np.array([first, first] + [HEIGHT / 3] * 5 + [HEIGHT] * 2 + [HEIGHT / 3] * 3)
    heights = np.append(heights, HEIGHT)
    points, volumes = [(1.0, 1.0, 1.0)], []
    for z, height in zip(np.cumsum(heights), heights, strict=True):
        points += [(1.0, 1.0, float(z)), (4.0, 1.0, float(z))]
        volumes += [0.0, 3 * WIDTH * height]
    found = deposit(motion(points, volumes), AREA, 0.01)
    share = found.volume[:, :, found.volume.shape[2] // 2] / 255.0
    filled = share.sum(axis=1)[share.max(axis=1) > 0.99] * 0.01
    assert filled == pytest.approx(np.full(len(filled), WIDTH), abs=0.011)
    assert (share > 0.5).any(axis=1).sum() * 0.01 == pytest.approx(heights.sum(), abs=0.021)


def test_embedded_filament_has_the_diameter_of_its_dose() -> None:
    ends = [(1.0, 1.0, 1.0), (1.5, 1.0, 4.0), (4.0, 3.0, 6.0)]
    length = [float(np.linalg.norm(np.subtract(b, a))) for a, b in pairwise(ends)]
    radius = 0.25
    volumes = [np.pi * radius**2 * each for each in length]
    found = deposit(motion(ends, volumes), AREA, 0.03)
    assert found.style == "embedded"
    caps = 4 / 3 * np.pi * radius**3
    assert found.volume_mm3 == pytest.approx(sum(volumes) + caps, rel=0.01)
    middle = (np.array([1.25, 1.0, 2.5]) - found.origin_mm) / 0.03
    across = found.volume[round(middle[2]), round(middle[1]), :] > 127
    lean = np.cos(np.arctan2(0.5, 3.0))
    assert across.sum() * 0.03 == pytest.approx(2 * radius / lean, abs=0.035)


def test_level_filaments_at_two_depths_are_round_where_the_caller_says_so() -> None:
    ends = [(1.0, 1.0, 1.0), (5.0, 1.0, 1.0), (5.0, 3.0, 2.5), (1.0, 3.0, 2.5)]
    volume = 4 * np.pi * 0.3**2
    level = motion(ends, [volume, 0.0, volume])
    (found,) = deposit_of_heads([level], [AREA], 0.03, style="embedded")
    assert found.style == "embedded"
    across = found.volume[:, :, found.volume.shape[2] // 2] > 127
    assert across.any(axis=1).sum() * 0.03 == pytest.approx(4 * 0.3, abs=0.07)
    assert across.any(axis=0).sum() * 0.03 == pytest.approx(4 * 0.3, abs=0.07)


def test_retraction_and_prime_deposit_nothing() -> None:
    line = [(1.0, 1.0, 0.06), (4.0, 1.0, 0.06), (4.0, 1.0, 0.06), (4.0, 1.0, 1.0)]
    line += [(1.0, 1.0, 0.12), (1.0, 1.0, 0.12), (4.0, 1.0, 0.12)]
    with_both = deposit(motion(line, [0.027, -0.5, 0.0, 0.0, 0.5, 0.027]), AREA, 0.02)
    without = deposit(motion(line, [0.027, 0.0, 0.0, 0.0, 0.0, 0.027]), AREA, 0.02)
    np.testing.assert_array_equal(with_both.volume, without.volume)
    assert with_both.standing_ul == pytest.approx(0, abs=1e-9)
    primed = deposit(motion(line, [0.027, 0.0, 0.0, 0.0, 0.3, 0.027]), AREA, 0.02)
    assert primed.standing_ul == pytest.approx(0.3)


def test_short_hop_between_lines_takes_no_ink_from_them() -> None:
    points, volume = [(0.0, 0.0, 0.06)], []
    for layer in (1, 2):
        for line in range(40):
            ends = (1.0, 2.2) if line % 2 else (2.2, 1.0)
            y = 1 + line * WIDTH
            points += [(ends[0], y, layer * HEIGHT), (ends[1], y, layer * HEIGHT)]
            volume += [0.0, 1.2 * WIDTH * HEIGHT]
    found = deposit(motion(points, volume), AREA, 0.01, plunger_step_mm=0.0026 / AREA)
    inner = found.volume[3:-3, 50:-50, 40:90] / 255.0
    assert inner.mean() > 0.99


def test_layer_painter_agrees_with_a_distance_test_at_every_fine_pixel() -> None:
    rng = np.random.default_rng(0)
    segments = rng.uniform(0.3, 1.7, (12, 4))
    segments[0, 2:] = segments[0, :2]  # a dot
    radius = rng.uniform(0.02, 0.2, 12)
    voxel, shape = 0.05, (40, 40)
    found = paint_layers(segments, radius, np.array([0, 7, 12]), np.zeros(3), voxel, shape)
    fine = (np.arange(40 * SUPERSAMPLE) + 0.5) * voxel / SUPERSAMPLE - voxel / 2
    x, y = np.meshgrid(fine, fine)
    for layer, which in enumerate((range(7), range(7, 12))):
        inside = np.zeros_like(x, dtype=bool)
        for s in which:
            a, b = segments[s, :2], segments[s, 2:]
            d = b - a
            t = ((x - a[0]) * d[0] + (y - a[1]) * d[1]) / max(d @ d, 1e-30)
            t = np.clip(t, 0, 1)
            inside |= np.hypot(x - a[0] - t * d[0], y - a[1] - t * d[1]) <= radius[s]
        share = inside.reshape(40, SUPERSAMPLE, 40, SUPERSAMPLE).mean(axis=(1, 3))
        assert np.abs(found[layer] / 255.0 - share).max() < 0.01


def test_filament_painter_agrees_with_a_distance_field() -> None:
    rng = np.random.default_rng(1)
    start, end = rng.uniform(0.5, 2.5, (2, 6, 3))
    end[0] = start[0]
    end[1, 2] = start[1, 2]
    radius = rng.uniform(0.1, 0.4, 6)
    found = paint_filaments(start, end, radius, np.zeros(3), 0.1, (30, 30, 30))
    z, y, x = np.meshgrid(*(0.1 * np.arange(30),) * 3, indexing="ij")
    points = np.stack([x, y, z], axis=-1)
    best = np.zeros(x.shape)
    for a, b, r in zip(start, end, radius, strict=True):
        t = np.clip((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-30), 0, 1)
        away = np.linalg.norm(points - a - t[..., None] * (b - a), axis=-1)
        best = np.maximum(best, np.clip(0.5 + (r - away) / 0.1, 0, 1))
    assert np.abs(found / 255.0 - best).max() < 0.01


def test_deposit_is_the_same_on_one_thread() -> None:
    many = deposit(hatch(), AREA, 0.02).volume
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        one = deposit(hatch(), AREA, 0.02).volume
    finally:
        numba.set_num_threads(threads)
    np.testing.assert_array_equal(one, many)


def test_no_ink_and_a_grid_too_large_are_refused() -> None:
    with pytest.raises(DepositError, match="nothing was deposited"):
        deposit(motion([(0.0, 0, 0), (1, 0, 0)], [0.0]), AREA, 0.02)
    far = motion([(0.0, 0, 0.06), (200, 0, 0.06), (200, 200, 0.12), (0, 200, 0.12)], [1.0, 0, 1.0])
    with pytest.raises(DepositError, match="larger voxel_mm"):
        deposit(far, AREA, 0.005)


def test_a_scanner_s_field_holds_whole_voxels_of_the_same_ink() -> None:
    found = deposit(hatch(), AREA, 0.02)
    box = np.array([[11.0, 10.5, -1.0], [12.5, 11.0, 0.13]])
    part = found.within(box)
    assert np.all(np.abs(part.bounds_mm[0] - np.maximum(box[0], found.bounds_mm[0])) <= 0.011)
    assert np.all(np.abs(part.bounds_mm[1] - np.minimum(box[1], found.bounds_mm[1])) <= 0.011)
    assert part.volume_mm3 < found.volume_mm3 / 4
    first = np.round((part.origin_mm - found.origin_mm) / found.voxel_mm).astype(int)[::-1]
    whole = tuple(slice(a, a + n) for a, n in zip(first, part.volume.shape, strict=True))
    assert np.array_equal(part.volume, found.volume[whole])
    with pytest.raises(DepositError, match="scanner's field"):
        found.within(box + 50.0)


# Ink written along older ink of a layer: volumes add up, and nothing else changes.


def lines(*each):
    """Strands of (start, end, area), each a stroke."""
    start, end, area = (np.array(one, dtype=float) for one in zip(*each, strict=True))
    number = np.arange(len(area))
    return Strands(start, end, area * np.linalg.norm(end - start, axis=1), area, number, number + 1)


SOUND = ((0, 0, 1), (7, 0, 1), 0.02)


def area_at(strands, x):
    low = np.minimum(strands.start, strands.end)[:, 0]
    high = np.maximum(strands.start, strands.end)[:, 0]
    return strands.area_mm2[(low < x) & (x < high)].sum()


@pytest.mark.parametrize("turned", [False, True])
def test_a_second_pass_fills_a_thin_line_up(turned):
    again = ((2, 0, 1), (5, 0, 1), 0.006)
    again = (again[1], again[0], 0.006) if turned else again
    found = united(lines(((0, 0, 1), (7, 0, 1), 0.014), again))
    assert area_at(found, 1.0) == pytest.approx(0.014)
    assert area_at(found, 3.5) == pytest.approx(0.02)
    assert area_at(found, 6.0) == pytest.approx(0.014)
    assert (found.area_mm2 > 0.015).sum() == 1, "the older piece is in the newer one"
    assert found.dose_ul.sum() == pytest.approx(7 * 0.014 + 3 * 0.006)


def test_several_passes_and_pieces_keep_the_volume():
    given = lines(
        ((0, 0, 1), (3, 0, 1), 0.02), ((3, 0, 1), (7, 0, 1), 0.02),
        ((2, 0.01, 1), (4, 0.01, 1), 0.01), ((2.5, 0, 1), (3.5, 0, 1), 0.004),
    )  # fmt: skip
    found = united(given)
    assert found.dose_ul.sum() == pytest.approx(given.dose_ul.sum())
    assert area_at(found, 3.2) == pytest.approx(0.034)
    assert area_at(found, 2.2) == pytest.approx(0.03)
    assert area_at(found, 0.5) == area_at(found, 6.5) == pytest.approx(0.02)


@pytest.mark.parametrize(
    "other",
    [
        ((0, 0.2, 1), (7, 0.2, 1), 0.02),
        ((3, -2, 1), (3, 2, 1), 0.02),
        ((0, 0, 1.02), (7, 0, 1.02), 0.02),
        ((7, 0, 1), (9, 0, 1), 0.02),
        ((7, 0, 1), (7, 3, 1), 0.02),
    ],
)
def test_neighbours_crossings_layers_and_ends_stay_as_they_are(other):
    given = lines(SOUND, other)
    assert united(given) is given or len(united(given)) == 2
