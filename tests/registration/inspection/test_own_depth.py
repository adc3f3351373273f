"""Filaments on a slope in a scanned bath, each judged at its own depth."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from registration.inspection import (
    ExpectedLines,
    LayerFindings,
    filament_map,
    height_map,
    see_layer,
)
from registration.scan import Scan

VOXEL = (0.015, 0.03, 0.03)
SHAPE = (240, 150, 240)
WIDE = 0.5
START = np.array([[1.0, 1.2, 0.4], [1.0, 3.2, 0.8]])
END = np.array([[6.0, 1.2, 3.0], [6.0, 3.2, 0.8]])


def _look(bare: tuple[float, float] | None, own: bool = True) -> LayerFindings:
    """Findings of clear filaments in a scattering bath, one leading up, one level."""
    rng = np.random.default_rng(6)
    z, y, x = np.meshgrid(*(d * np.arange(n) for d, n in zip(VOXEL, SHAPE, strict=True)),
                          indexing="ij", sparse=True)  # fmt: skip
    depth = 3.4
    ink = np.zeros(SHAPE, dtype=np.bool_)
    for number, (start, end) in enumerate(zip(START, END, strict=True)):
        length = float(np.linalg.norm(end - start))
        a, b, c = (end - start) / length
        along = (x - start[0]) * a + (y - start[1]) * b + (depth - z - start[2]) * c
        far = (x - start[0]) ** 2 + (y - start[1]) ** 2 + (depth - z - start[2]) ** 2 - along**2
        whole = (along > 0) & (along < length) & (far < (WIDE / 2) ** 2)
        ink |= whole & ~(
            (number == 0) & (bare is not None) & (along > (bare or (0, 0))[0])
            & (along < (bare or (0, 0))[1])
        )  # fmt: skip
    light = np.where(ink, 0.08, 1.0) * np.exp(-0.5 * z)
    voxels = np.asarray(4000.0 * light * rng.gamma(3.0, 1 / 3.0, SHAPE), dtype=np.uint16)
    scan = Scan(voxels, VOXEL, 1.0, False, "linear", "oct", True, Path("painted"))
    to_scan = np.diag([1.0, 1.0, -1.0, 1.0])
    to_scan[2, 3] = depth
    count = np.arange(2)
    lines = ExpectedLines(START, END, np.full(2, WIDE), count, count, np.ones(2, dtype=np.bool_))
    picture, frame = height_map(scan, to_scan, 1.7, 3.1, lines)
    picture = filament_map(scan, frame, lines) if own else picture[:, :, :1]
    return see_layer(picture, frame, lines)


def test_a_sound_filament_that_leads_up_is_seen() -> None:
    """By one slab over all its heights nothing of it was seen."""
    found = _look(None)
    assert found.gaps == ()
    assert found.unseen == ()
    assert found.seen_share > 0.9
    assert _look(None, own=False).seen_share < found.seen_share


@pytest.mark.parametrize("bare", [(2.0, 3.0), (0.0, 2.5)])
def test_what_is_missing_of_it_is_found(bare: tuple[float, float]) -> None:
    (gap,) = _look(bare).gaps
    assert gap.stroke == 0
    assert (gap.from_mm, gap.to_mm) == pytest.approx(bare, abs=0.3)


@pytest.mark.parametrize("times", [3.0, 30.0, 2000.0])
def test_bright_ink_is_no_wider_than_it_is(times: float) -> None:
    """By the logarithm alone its blurred rim counted as ink: 0.25 mm were told 25 to 30 % wide."""
    rng = np.random.default_rng(8)
    wide, (dz, dy, dx), shape, depth = 0.25, (0.012, 0.024, 0.024), (120, 120, 220), 1.0
    z, y, x = np.meshgrid(*(d * np.arange(n) for d, n in zip((dz, dy, dx), shape, strict=True)),
                          indexing="ij", sparse=True)  # fmt: skip
    inside = ((y - 1.4) ** 2 + (depth - z - 0.3) ** 2 < (wide / 2) ** 2) & (x > 0.6) & (x < 4.6)
    light = _blurred(inside.astype(np.float32), 0.5)
    light = 1.0 + (times - 1.0) * light * np.exp(-1.4 * z)
    voxels = np.asarray(8.0 * light * rng.gamma(3.0, 1 / 3.0, shape), dtype=np.float32)
    scan = Scan(voxels, (dz, dy, dx), 1.0, False, "linear", "oct", True, Path("painted"))
    to_scan = np.diag([1.0, 1.0, -1.0, 1.0])
    to_scan[2, 3] = depth
    ends = np.array([[[0.6, 1.4, 0.3]], [[4.6, 1.4, 0.3]]])
    one = np.zeros(1, dtype=np.int64)
    fresh = np.ones(1, dtype=np.bool_)
    lines = ExpectedLines(ends[0], ends[1], np.full(1, wide), one, one, fresh)
    _, frame = height_map(scan, to_scan, 0.3, wide, lines)
    found = see_layer(filament_map(scan, frame, lines), frame, lines)
    assert found.gaps == ()
    assert found.width_ratio == pytest.approx(1.0, abs=0.1)


def _blurred(ink: np.ndarray, sigma: float) -> np.ndarray:
    return np.stack([cv2.GaussianBlur(one, (0, 0), sigma) for one in ink])
