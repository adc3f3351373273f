"""Older filaments that lie clearly below the judged one hide nothing of it."""

from pathlib import Path

import numpy as np
import pytest

from registration.inspection import (
    ExpectedLines,
    LayerFindings,
    ShownLines,
    filament_map,
    height_map,
    see_layer,
)
from registration.scan import Scan

VOXEL = (0.015, 0.03, 0.03)
SHAPE = (120, 120, 170)
WIDE, DEPTH, UPPER = 0.4, 1.7, 1.2


def _lines(lower: float) -> ExpectedLines:
    """A fresh line along x, and an older one that crosses it ``lower`` mm below."""
    start = np.array([[2.5, 0.6, UPPER - lower], [0.6, 1.8, UPPER]])
    end = np.array([[2.5, 3.0, UPPER - lower], [4.4, 1.8, UPPER]])
    count = np.arange(2)
    return ExpectedLines(start, end, np.full(2, WIDE), count, count, count == 1)


def _look(lower: float, bare: tuple[float, float] | None) -> LayerFindings:
    rng, lines = np.random.default_rng(3), _lines(lower)
    z, y, x = np.meshgrid(*(d * np.arange(n) for d, n in zip(VOXEL, SHAPE, strict=True)),
                          indexing="ij", sparse=True)  # fmt: skip
    up = DEPTH - z
    older = ((x - 2.5) ** 2 + (up - UPPER + lower) ** 2 < (WIDE / 2) ** 2) & (abs(y - 1.8) < 1.2)
    fresh = ((y - 1.8) ** 2 + (up - UPPER) ** 2 < (WIDE / 2) ** 2) & (abs(x - 2.5) < 1.9)
    if bare is not None:
        fresh &= ~((x > 0.6 + bare[0]) & (x < 0.6 + bare[1]))
    light = np.where(older | fresh, 4.0, 1.0) * np.exp(-0.5 * z)
    voxels = np.asarray(2000.0 * light * rng.gamma(3.0, 1 / 3.0, SHAPE), dtype=np.uint16)
    scan = Scan(voxels, VOXEL, 1.0, False, "linear", "oct", True, Path("painted"))
    to_scan = np.diag([1.0, 1.0, -1.0, 1.0])
    to_scan[2, 3] = DEPTH
    _, frame = height_map(scan, to_scan, UPPER, WIDE, lines)
    shown = ShownLines.of(lines, frame, depth_down=True)
    return shown.as_given(see_layer(filament_map(scan, frame, lines), frame, shown.lines))


def test_a_gap_above_older_ink_is_found() -> None:
    """It passed silently: older ink was taken to hide it, at whatever depth."""
    found = _look(0.8, (1.65, 2.15))
    (gap,) = found.gaps
    assert (gap.from_mm, gap.to_mm) == pytest.approx((1.65, 2.15), abs=0.1)
    assert (found.stations.piece == 1).all()


@pytest.mark.parametrize("lower", [0.3, 0.8])
def test_sound_ink_above_older_ink_is_seen(lower: float) -> None:
    found = _look(lower, None)
    assert found.gaps == ()
    assert found.seen_share > (0.95 if lower > 0.5 else 0.8)
