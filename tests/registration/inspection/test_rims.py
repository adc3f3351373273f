"""Ink that an OCT shows by its rim, as clear hydrogel, and fresh vessels that cross."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from registration.inspection import (
    ExpectedLines,
    HeightFrame,
    LayerFindings,
    better_turned,
    filament_map,
    height_map,
    see_layer,
)
from registration.scan import Scan

VOXEL = (0.012, 0.025, 0.025)
SHAPE = (110, 130, 220)
DEPTH = 1.3
Pieces = list[tuple[tuple[float, float, float], tuple[float, float, float]]]


def _scanned(
    pieces: Pieces,
    wide: float,
    actual: float,
    level: float,
    rim: tuple[float, float],
    bare: dict[int, tuple[float, float]] | None = None,
) -> tuple[Scan, NDArray[np.float64], ExpectedLines]:
    """Volume of straight filaments: ink's ``level``, its rim's level and thickness."""
    rng = np.random.default_rng(4)
    z, y, x = np.meshgrid(*(d * np.arange(n) for d, n in zip(VOXEL, SHAPE, strict=True)),
                          indexing="ij", sparse=True)  # fmt: skip
    away = np.full(SHAPE, 9.0, dtype=np.float32)
    for number, piece in enumerate(pieces):
        start, end = np.array(piece)
        length = float(np.linalg.norm(end - start))
        way, off = (end - start) / length, (x - start[0], y - start[1], DEPTH - z - start[2])
        along = sum(a * b for a, b in zip(off, way, strict=True))
        inner = np.clip(along, 0.0, length)
        if bare and number in bare:
            low, high = bare[number]
            before, after = np.minimum(inner, low), np.maximum(inner, high)
            inner = np.where(along < 0.5 * (low + high), before, after)
        far = sum((a - inner * b) ** 2 for a, b in zip(off, way, strict=True))
        away = np.minimum(away, np.sqrt(far) - actual / 2).astype(np.float32)
    light = np.where(away < 0, np.where(away > -rim[1], rim[0], level), 1.0)
    shade = np.cumsum(np.where(away < 0, 1.2, 0.4) * VOXEL[0], axis=0)
    light = np.stack([cv2.GaussianBlur(one, (0, 0), 0.7) for one in light * np.exp(-2.0 * shade)])
    voxels = np.asarray(4000.0 * light * rng.gamma(2.0, 0.5, SHAPE), dtype=np.uint16)
    scan = Scan(voxels, VOXEL, 1.0, False, "linear", "oct", True, Path("painted"))
    to_scan = np.diag([1.0, 1.0, -1.0, 1.0])
    to_scan[2, 3] = DEPTH
    ends, count = np.array(pieces, dtype=np.float64), np.arange(len(pieces))
    one = np.ones(len(pieces))
    lines = ExpectedLines(ends[:, 0], ends[:, 1], wide * one, count, count, one > 0)
    return scan, to_scan, lines


def _look(*case: object, **more: object) -> LayerFindings:
    scan, to_scan, lines = _scanned(*case, **more)  # type: ignore[arg-type]
    frame = _frame(scan, to_scan, lines)
    return see_layer(filament_map(scan, frame, lines), frame, lines)


def _frame(scan: Scan, to_scan: NDArray[np.float64], lines: ExpectedLines) -> HeightFrame:
    return height_map(scan, to_scan, 0.7, 0.6, lines)[1]


LONE: Pieces = [((0.7, 1.6, 0.7), (4.8, 1.7, 0.7))]
ROWS: Pieces = [((0.7, 1.0 + 0.45 * k, 0.7), (4.8, 1.0 + 0.45 * k, 0.7)) for k in range(4)]


@pytest.mark.parametrize("actual", [0.42, 0.5, 0.54])
@pytest.mark.parametrize(("level", "bright"), [(0.9, 3.5), (1.0, 5.0), (0.5, 2.5)])
def test_width_is_told_from_rim_to_rim(actual: float, level: float, bright: float) -> None:
    """Of a dark middle and bright rims the middle alone was told: 53 % of the width."""
    found = _look(LONE, 0.5, actual, level, (bright, 0.045))
    assert found.gaps == ()
    assert found.width_ratio == pytest.approx(actual / 0.5, abs=0.1)
    assert abs(found.width_ratio - actual / 0.5) < 2.0 * found.u_width_ratio


def test_thin_filaments_side_by_side_that_show_by_their_rims_are_seen() -> None:
    """Rims that lie near others told nothing; a mean over the whole height shows the middle."""
    found = _look(ROWS, 0.36, 0.36, 1.0, (5.0, 0.05))
    assert found.seen_share > 0.95
    assert found.gaps == ()
    gaps = _look(ROWS, 0.36, 0.36, 1.0, (5.0, 0.05), bare={1: (1.5, 2.5)}).gaps
    assert [gap.stroke for gap in gaps] == [1]
    assert gaps[0].length_mm == pytest.approx(0.64, abs=0.2)  # from tip to tip of round ends


def test_a_vessel_that_shows_by_its_rim_is_not_told_as_turned() -> None:
    """At its own depth it hardly fits its filled line, and turned by chance as well."""
    scan, to_scan, lines = _scanned([((0.8, 0.7, 0.7), (1.3, 2.6, 0.7))], 0.68, 0.68, 0.94,
                                    (5.8, 0.04))  # fmt: skip
    picture, frame = height_map(scan, to_scan, 0.7, 0.7, lines)
    assert better_turned(picture, frame, lines, scan, in_parts=False) is None
    turned = scan.volume[:, ::-1, ::-1]
    other = Scan(turned, VOXEL, 1.0, False, "linear", "oct", True, Path("painted"))
    picture, frame = height_map(other, to_scan, 0.7, 0.7, lines)
    assert better_turned(picture, frame, lines, other, in_parts=False) == "turned by 180°"
