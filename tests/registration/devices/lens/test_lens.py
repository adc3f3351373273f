"""Lens calibration from rendered board pictures."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from registration.devices.lens import (
    Board,
    BoardView,
    Lens,
    find_board,
    fit_lens,
    read_lens,
    write_lens,
)
from registration.errors import PictureError
from tests.registration.devices.lens.rendered import Rig, photographed
from tests.slower import first_of

BOARD = Board(11, 8, 2.0, 1.5)
SEVERAL = ((0, 0, 0), (22, 5, 0), (-18, 12, 90), (8, -24, 20), (-10, -15, 180))


def view(folder: Path, rig: Rig, seed: int = 0) -> BoardView:
    path = folder / f"board{seed}.png"
    assert cv2.imwrite(str(path), photographed(BOARD, rig, seed))
    return find_board(path, BOARD)


def off_px(lens: Lens, rig: Rig) -> float:
    """Worst place of the picture, a similarity about the middle left free: no zoom is known."""
    u, v = np.meshgrid(*(np.linspace(0, side - 1, 15) for side in rig.size_px))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    seen, true = lens.straight_pixels(pixels) - rig.middle_px, rig.ideal(pixels) - rig.middle_px
    return float(np.abs(seen * (seen * true).sum() / (seen * seen).sum() - true).max())


@pytest.mark.parametrize("tilt", first_of([(1.5, -2.0, 77.0), (0.0, 0.0, 0.0)]))
def test_one_picture_of_a_plane_tells_scale_and_distortion(tmp_path, tilt):
    rig = Rig(distortion=(-0.35, 0.0), tilt_deg=tilt)
    lens = fit_lens([view(tmp_path, rig)])
    assert lens.bends_px > 2
    assert off_px(lens, rig) < 0.25
    assert lens.um_per_px == pytest.approx(rig.true_um_per_px, rel=2e-4)
    low, high = lens.um_per_px_95
    assert high - low < 2e-3 * lens.um_per_px


@pytest.mark.slow
def test_tilted_pictures_tell_the_focal_length_as_well(tmp_path: Path) -> None:
    wide = {"focal_px": 660.0, "distortion": (-0.2, 0.05)}
    rigs = [Rig(**wide, tilt_deg=tilt) for tilt in SEVERAL]
    lens = fit_lens([view(tmp_path, rig, seed) for seed, rig in enumerate(rigs)])
    assert lens.focal_px == pytest.approx(660.0, rel=5e-3)
    np.testing.assert_allclose(lens.distortion[:2], (-0.2, 0.05), atol=0.03)
    assert off_px(lens, rigs[0]) < 0.25
    assert lens.um_per_px == pytest.approx(37.0, rel=3e-4)


def test_a_picture_is_straightened_and_another_size_refused(tmp_path: Path) -> None:
    rig = Rig(distortion=(-0.35, 0.0))
    seen = photographed(BOARD, rig)
    lens = fit_lens([view(tmp_path, rig)])
    straight = lens.straighten(seen, Path("seen.png")).astype(float)
    level = photographed(BOARD, Rig(um_per_px=lens.um_per_px), 1).astype(float)
    inner = (slice(30, -30), slice(30, -30))
    assert np.abs(straight - level)[inner].mean() < 0.5 * np.abs(seen - level)[inner].mean()
    with pytest.raises(PictureError, match=r"seen.png has 300 x 460 px.* calibrated at 600 x 460"):
        lens.straighten(seen[:, ::2], Path("seen.png"))


def test_too_little_of_a_board_is_refused(tmp_path: Path) -> None:
    part = tmp_path / "part.png"
    assert cv2.imwrite(str(part), photographed(BOARD, Rig())[:110])
    with pytest.raises(PictureError, match="corners of the board are found"):
        find_board(part, BOARD)
    with pytest.raises(PictureError, match="one size; these are none"):
        fit_lens([])


@pytest.mark.parametrize(
    ("board", "words"),
    [
        ((2, 8, 2.0, 1.5, "5X5_100"), "3 to 99 a side"),
        ((11, 8, 2.0, 2.5, "5X5_100"), "don't fit into squares"),
        ((11, 8, 2.0, 1.5, "9X9_100"), "no set of markers '9X9_100'"),
        ((30, 20, 2.0, 1.5, "5X5_100"), "hold 300 markers, and 5X5_100 has 100"),
    ],
)
def test_boards_that_cant_be_are_refused(board: tuple, words: str) -> None:
    with pytest.raises(PictureError, match=words):
        Board(*board)


def test_the_file_comes_back_and_a_wrong_one_is_refused(tmp_path: Path) -> None:
    lens = Lens(
        size_px=(900, 700), focal_px=2700.5, centre_px=(449.5, 349.5), distortion=(-0.3, 0.1),
        um_per_px=25.01, um_per_px_95=(25.0, 25.02), off_px=0.03,
    )  # fmt: skip
    path = tmp_path / "camera.yaml"
    write_lens(path, lens)
    assert read_lens(path) == lens
    path.write_text(path.read_text().replace("focal_px: 2700.5", "focal_px: -1"))
    with pytest.raises(PictureError, match="focal_px: Input should be greater than 0"):
        read_lens(path)
    with pytest.raises(PictureError, match="printctl calibrate camera"):
        read_lens(tmp_path / "none.yaml")


def test_a_lens_that_cannot_be_read_is_named_by_its_option(tmp_path: Path) -> None:
    with pytest.raises(PictureError, match=r"--lens .*none\.yaml"):
        read_lens(tmp_path / "none.yaml", "--lens")
