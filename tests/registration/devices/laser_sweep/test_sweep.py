"""Heights by a camera's pictures of a swept laser line; painter and truth are a checker's."""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from registration.devices.laser_sweep import fit_laser, read_laser, sweep_heights, trace
from registration.devices.laser_sweep.pictures import sweep_pictures
from registration.devices.lens.lens import write_model as write_laser
from registration.errors import PictureError
from tests.registration.devices.camera_frame import scene
from tests.registration.devices.laser_sweep import sweeps

NOW = datetime(2026, 11, 27, tzinfo=UTC)


@pytest.mark.parametrize("kind", ["turns", "moves"])
def test_blocks_have_their_height_whatever_way_the_laser_sweeps(kind: str, tmp_path: Path) -> None:
    found = sweeps.fitted(tmp_path / "flat", kind)
    write_laser(tmp_path / "laser.yaml", found.laser)
    laser = read_laser(tmp_path / "laser.yaml")
    assert laser == found.laser
    assert found.pictures >= 20
    traced = trace(sweeps.written(sweeps.over_blocks(kind), tmp_path / "look"), laser.frame)
    heights = sweep_heights(traced, laser, sweeps.LOW, sweeps.HIGH)
    side = heights.pixel_mm[0]
    y, x = np.indices(heights.height_mm.shape) * side
    for left, right, high in sweeps.BLOCKS:
        inner = (x > left + 0.3) & (x < right - 0.3) & (y > 1.3) & (y < 5.7)
        off = 1e3 * (heights.height_mm[inner] - sweeps.FLOOR_Z - high)
        assert np.isfinite(off).mean() > 0.9
        assert abs(np.nanmean(off)) < 8  # µm
        assert np.nanstd(off) < 25
        assert abs(np.nanmean(off)) < 1.96 * laser.u_um[0] + 5


def test_a_laser_led_by_hand_is_refused(tmp_path: Path) -> None:
    traced = trace(sweeps.written(sweeps.flat(), tmp_path / "flat"), scene.frame())
    rng = np.random.default_rng(1)
    shaken = replace(traced, profiles=tuple(
        replace(one, ends=one.ends + np.append(rng.normal(0, 0.15, 2), 0.0))
        for one in traced.profiles
    ))  # fmt: skip
    with pytest.raises(PictureError, match="share no point"):
        fit_laser(shaken, scene.frame(), sweeps.FLOOR_Z, NOW)


def test_a_sweep_that_tells_nothing_is_refused(tmp_path: Path) -> None:
    traced = trace(sweeps.written(sweeps.flat(), tmp_path / "flat"), scene.frame())
    with pytest.raises(PictureError, match=r"0\.20 mm from the plate's face"):
        fit_laser(traced, scene.frame(), scene.frame().middle_mm[2] - 0.2, NOW)
    with pytest.raises(PictureError, match="height is nan mm; touch the face"):
        fit_laser(traced, scene.frame(), float("nan"), NOW)
    few = sweeps.written(sweeps.flat()[:9], tmp_path / "few")
    with pytest.raises(PictureError, match=r"in [5-9] of 9 pictures \(12 wanted\)"):
        trace(few, scene.frame())
    (tmp_path / "none").mkdir()
    with pytest.raises(PictureError, match="holds no picture"):
        trace(tmp_path / "none", scene.frame())
    small = sweeps.written([one[::2, ::2] for one in sweeps.flat()[:3]], tmp_path / "small")
    with pytest.raises(PictureError, match="500 x 400 px"):
        trace(small, scene.frame())
    near = replace(traced, profiles=traced.profiles[:1] * 20)
    with pytest.raises(PictureError, match="sweep farther"):
        fit_laser(near, scene.frame(), sweeps.FLOOR_Z, NOW)


def test_heights_of_a_reflected_line_dont_mix_with_true_ones(tmp_path: Path) -> None:
    laser = sweeps.fitted(tmp_path / "flat").laser
    traced = trace(sweeps.written(sweeps.over_blocks(), tmp_path / "look"), laser.frame)
    sound = sweep_heights(traced, laser, sweeps.LOW, sweeps.HIGH).height_mm
    away = np.array([0.0, 2.0 / laser.frame.eye_mm[2]])  # its line lies 2 mm beside
    both = replace(traced, profiles=tuple(
        replace(one, slopes=np.concatenate([one.slopes, one.slopes[::3] + away]))
        for one in traced.profiles
    ))  # fmt: skip
    heights = sweep_heights(both, laser, sweeps.LOW, sweeps.HIGH).height_mm
    off = np.abs(heights - sound)
    assert np.isfinite(off).mean() > 0.2
    assert np.nanmax(off) < 0.3


def test_pages_and_a_video_are_read_as_a_folder_is(tmp_path: Path) -> None:
    pictures = sweeps.flat()[:4]
    tifffile.imwrite(tmp_path / "all.tif", np.stack(pictures), photometric="minisblack")
    with sweep_pictures(tmp_path / "all.tif") as each:
        for one, read in zip(pictures, each, strict=True):
            assert np.array_equal(read(), one)
    codec = cv2.VideoWriter.fourcc(*"MJPG")
    film = cv2.VideoWriter(str(tmp_path / "all.avi"), codec, 30.0, pictures[0].shape[::-1])
    for one in pictures:
        film.write(cv2.cvtColor(one, cv2.COLOR_GRAY2BGR))
    film.release()
    with sweep_pictures(tmp_path / "all.avi") as each:
        seen = [read() for read in each]
    assert len(seen) == 4
    assert np.abs(seen[2].mean(axis=2) - pictures[2]).mean() < 3
