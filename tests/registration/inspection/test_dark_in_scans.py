"""Clear filaments in a scattering bath, scanned with axes mixed up, or moved."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from registration.inspection import (
    ExpectedLines,
    HeightFrame,
    better_turned,
    filament_map,
    height_map,
)
from registration.inspection.values import FloatImage
from registration.scan import Scan

VOXEL = (0.02, 0.03, 0.03)
SHAPE = (90, 150, 240)
WIDE = 0.45
Turn = Callable[[NDArray[Any]], NDArray[Any]]
BENT = np.array([[1.2, 1.0, 0.9], [3.2, 1.2, 0.9], [4.6, 2.8, 0.9]])


def _scanned(
    points: NDArray[Any], turn: Turn, by_mm: float = 0.0
) -> tuple[FloatImage, FloatImage, HeightFrame, ExpectedLines]:
    """Map of a slab, and at the filament's own depth; frame and lines of one filament."""
    rng = np.random.default_rng(8)
    z, y, x = np.meshgrid(*(d * np.arange(n) for d, n in zip(VOXEL, SHAPE, strict=True)),
                          indexing="ij", sparse=True)  # fmt: skip
    ink = np.zeros(SHAPE, dtype=np.bool_)
    for start, end in pairwise(points):
        way = end - start
        off = (x - start[0] - by_mm, y - start[1], 1.8 - z - start[2])
        share = sum(a * b for a, b in zip(off, way, strict=True)) / float(way @ way)
        share = np.clip(share, 0.0, 1.0)
        ink |= sum((a - share * b) ** 2 for a, b in zip(off, way, strict=True)) < (WIDE / 2) ** 2
    light = np.where(ink, 0.08, 1.0) * np.exp(-0.5 * z)
    voxels = np.asarray(4000.0 * light * rng.gamma(3.0, 1 / 3.0, SHAPE), dtype=np.uint16)
    voxels = np.ascontiguousarray(turn(voxels))
    scan = Scan(voxels, VOXEL, 1.0, False, "linear", "oct", True, Path("painted"))
    to_scan = np.diag([1.0, 1.0, -1.0, 1.0])
    to_scan[2, 3] = 1.8
    count = np.arange(len(points) - 1)
    one = np.ones(len(count))
    lines = ExpectedLines(
        points[:-1], points[1:], WIDE * one, count, 0 * count, np.ones(len(count), dtype=np.bool_)
    )
    picture, frame = height_map(scan, to_scan, 0.9, WIDE, lines)
    return picture, filament_map(scan, frame, lines), frame, lines


@pytest.mark.parametrize(
    ("turn", "said"),
    [
        (lambda v: v, None),
        (lambda v: v[:, ::-1, ::-1], "turned by 180°"),
        (lambda v: v[:, :, ::-1], "mirrored along x"),
        (lambda v: v[:, ::-1], "mirrored along y"),
        (lambda v: v.transpose(0, 2, 1), "with x and y exchanged"),
    ],
)
def test_ink_darker_than_the_bath_is_told_when_turned(turn: Turn, said: str | None) -> None:
    """It correlates with its lines below zero, and any turn was as good as any other."""
    picture, _, frame, lines = _scanned(BENT, turn)
    assert better_turned(picture, frame, lines) == said
