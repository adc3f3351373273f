"""Constant A-scans and picture blocks hold no measurement: they aren't seen, and are no gaps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from registration.inspection import Unseen, see_layer
from tests.registration.inspection.oct_volumes import area, painted
from tests.registration.inspection.painted import Scene, expected

SINGLE = [(0, 0.0, 0.0, 3.0, 0.0), (0, 0.0, 1.5, 3.0, 1.5), (0, 0.0, 3.0, 3.0, 3.0)]
LATTICE = area(3, 4, 0.8)


@pytest.mark.parametrize("value", [0, 200])
@pytest.mark.parametrize(("pieces", "gap"), [(SINGLE, (0, 1.0, 1.6)), (LATTICE, (9, 1.0, 1.7))])
def test_constant_ascans_are_not_seen_and_a_gap_beside_them_is_found(pieces, gap, value):
    volume = painted(pieces, [gap])
    voxels = volume.voxels.copy()
    voxels[:, :, voxels.shape[2] * 3 // 5 : voxels.shape[2] * 3 // 5 + 15] = value
    voxels[:, voxels.shape[1] // 2 + 8 :, :] = value
    found = replace(volume, voxels=voxels).look()
    assert [one.stroke for one in found.gaps] == [gap[0]]
    assert (found.gaps[0].from_mm, found.gaps[0].to_mm) == pytest.approx(gap[1:], abs=0.1)
    assert Unseen.HIDDEN in found.stations.why


def test_a_volume_of_which_half_is_constant_shows_no_gap():
    volume = painted(area(1, 10))
    voxels = volume.voxels.copy()
    voxels[:, voxels.shape[1] // 2 :] = 0
    found = replace(volume, voxels=voxels).look()
    assert found.gaps == ()
    assert 0.3 < found.seen_share < 0.7


@pytest.mark.parametrize("value", [0, 128, None])
def test_a_lost_block_of_a_picture_is_not_seen(value):
    layer = Scene(3, layout="meander").paint(((0, 1.0, 1.4),))
    lines, picture = expected(layer.plan), layer.picture.copy()
    middle = 0.5 * (lines.start + lines.end)
    way = np.cumsum(np.linalg.norm(lines.end - lines.start, axis=1))
    x, y = layer.frame.to_pixels(middle[np.argmin(np.abs(way - 3.0))][None])[0].astype(int)
    block = np.s_[y - 16 : y + 16, x - 20 : x + 20]
    picture[block] = picture[2, 2] if value is None else value
    picture[y + 30] = picture[2, 2]  # a dead row
    found = see_layer(picture, layer.frame, lines)
    assert [(g.from_mm, g.to_mm) for g in found.gaps] == [pytest.approx((1.0, 1.4), abs=0.1)]
    assert (found.stations.why == Unseen.HIDDEN).sum() >= 4


def noisy(shape, level, rng):
    return np.clip(rng.normal(level, 4.0, shape), 0, 255).astype(np.uint8)
