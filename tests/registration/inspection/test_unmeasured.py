"""Constant A-scans and picture blocks hold no measurement: they aren't seen, and are no gaps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from registration.inspection import Unseen, see_layer
from registration.inspection.pictures.unmeasured import unmeasured_pixels, unmeasured_scans
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


def test_ascans_with_any_change_over_depth_are_measured():
    volume = np.full((5, 3, 4), 7, np.uint16)
    volume[2, 1, 2] = 8
    measured = ~unmeasured_scans(volume)
    assert np.argwhere(measured).tolist() == [[1, 2]]


@pytest.mark.parametrize("axis", [1, 2])
def test_bscans_that_repeat_the_one_before_are_not_measured(axis):
    """A scanner that hung showed the rest of a line as bath, and 0.6 mm were mended."""
    rng = np.random.default_rng(2)
    volume = np.moveaxis(rng.integers(0, 200, (20, 30, 40), dtype=np.uint16), 0, axis)
    scans = np.moveaxis(volume, axis, 0)
    scans[12:] = scans[11]
    scans[3] = scans[2]
    lost = np.moveaxis(unmeasured_scans(volume), axis - 1, 0).all(axis=1)
    assert np.flatnonzero(lost).tolist() == [3, *range(12, 20)]


def test_a_volume_painted_without_noise_was_measured():
    volume = np.repeat(np.arange(20, dtype=np.uint16)[:, None] + np.zeros((1, 9)), 7, axis=1)
    assert not unmeasured_scans(volume.reshape(20, 7, 9)).any()


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


def test_glare_and_pictures_with_blocks_of_one_value_nearly_everywhere_were_measured():
    rng = np.random.default_rng(4)
    picture = noisy((200, 300, 3), 90, rng)
    assert not unmeasured_pixels(picture).any()
    glare = picture.copy()
    glare[20:60, 20:60] = 255
    assert not unmeasured_pixels(glare).any()
    clipped = noisy((200, 300), 0, rng) * np.uint8(0)  # bath below black, lines above
    for y in range(10, 200, 30):
        clipped[y : y + 8] = noisy((8, 300), 90, rng)
    assert not unmeasured_pixels(clipped).any()


@pytest.mark.parametrize("share", [0.05, 0.5, 0.7])
def test_lost_packets_of_up_to_most_of_a_picture_are_told(share):
    picture = noisy((200, 300), 90, np.random.default_rng(4))
    lost = np.zeros(picture.shape, dtype=np.bool_)
    lost[200 - round(200 * share) :] = True
    picture[lost] = 90
    assert np.mean(unmeasured_pixels(picture) == lost) > 0.99


@pytest.mark.parametrize("kept", [0.1, 0.22, 0.6])
def test_a_picture_that_broke_off_early_is_lost_from_there(kept: float) -> None:
    """Where more than three quarters were of one value, they counted as measured."""
    picture = np.random.default_rng(3).normal(120.0, 4.0, (200, 300)).astype(np.uint8)
    rest = round(kept * 200)
    picture[rest:] = 128
    lost = unmeasured_pixels(picture)
    assert lost[rest + 1 :].all()
    assert not lost[: rest - 1].any()
