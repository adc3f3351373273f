"""Filaments on a slope in a scanned bath, each judged at its own depth."""

from pathlib import Path

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
