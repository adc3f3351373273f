"""Pictures that devices give, and frames that don't hold."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from printctl.errors import UsageError
from printctl.observe import views
from printctl.observe import views as camera_holds
from printctl.observe.devices import DeviceError
from printctl.observe.look_values import Look
from printctl.observe.records import LookRecord, look_folder, save_look
from printctl.observe.view_before import EMPTY, image_before, picture_before
from registration.devices.camera_frame.frame import CameraFrame


@dataclass
class Check:
    """Stands for `FrameCheck`."""

    holds: bool
    why: tuple[str, ...] = ("marks moved by 180 µm",)


@pytest.mark.parametrize("holds", [True, False])
def test_a_moved_camera_is_refused_at_each_picture(tmp_path, monkeypatch, holds):
    path = tmp_path / "picture.png"
    cv2.imwrite(str(path), np.full((32, 32), 200, np.uint8))
    frame = CameraFrame.model_construct()
    monkeypatch.setattr(views, "camera_frame", lambda order: frame)
    monkeypatch.setattr(camera_holds, "check_frame", lambda image, frame, path: Check(holds))
    order = type("Order", (), {"oct": False, "laser": False})()
    if holds:
        assert views.open_view(path, order, 1.0, 0.1)[1] is frame
    else:
        with pytest.raises(DeviceError, match="180 µm; else fit it anew"):
            views.open_view(path, order, 1.0, 0.1)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_black_picture_is_told_as_that(tmp_path, dtype):
    """It was told as a frame to be fitted anew: no marks are found in the dark."""
    black = np.zeros((32, 32), dtype)
    with pytest.raises(DeviceError, match=r"now.png is black.* 0.0% of the range; is the light on"):
        camera_holds.refuse_moved(black, CameraFrame.model_construct(), tmp_path / "now.png")


def test_half_a_jpeg_is_no_picture(tmp_path):
    path = tmp_path / "IMG_1.JPG"
    noise = np.random.default_rng(1).integers(0, 255, (64, 64), np.uint8)
    whole = cv2.imencode(".jpg", noise)[1].tobytes()
    path.write_bytes(whole)
    assert views.read_picture(path).shape == (64, 64)
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DeviceError, match="is cut off"):
        views.read_picture(path)


@pytest.mark.parametrize("name", ["picture.npz", "picture.tif"])
def test_what_is_no_scan_is_told(tmp_path, monkeypatch, name):
    path = tmp_path / name
    path.write_bytes(b"PK" + bytes(100))
    monkeypatch.setattr(views, "_oct_frame", lambda path, order: np.eye(4))
    order = type("Order", (), {"oct": True, "laser": False})()
    with pytest.raises(DeviceError, match="broken archive"):
        views.open_view(path, order, 1.0, 0.1)


@pytest.mark.parametrize("text", ["", "printer_to_scan: [[1, 0], [0, 1]]", "printer_to_scan: no"])
def test_an_octs_frame_is_four_by_four(tmp_path, text):
    path = tmp_path / "frame.yaml"
    path.write_text(text)
    with pytest.raises(UsageError, match="printer_to_scan"):
        views.read_oct_frame(path)


# --- the picture that counts as the one before a look's layer
LOOK = Look(3, 300, 300, 200, "end of layer 2")


def record(number: int, done: int, at: float = 100.0) -> LookRecord:
    return LookRecord(number, done, done, "", at, "go_on", "", found={"seen_share": 1.0})


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for number in (1, 2, 3):
        (look_folder(tmp_path, number) / "picture.png").touch()
    save_look(tmp_path, record(1, 100))
    save_look(tmp_path, record(2, 200))
    return tmp_path


def now(folder: Path) -> Path:
    return folder / "looks" / "0003" / "picture.png"


def test_the_look_that_directly_precedes_gives_it(folder: Path) -> None:
    assert picture_before(folder, 0.0, LOOK, now(folder)) == folder / "looks/0002/picture.png"


def test_pictures_of_other_prints_of_long_ago_and_of_looks_not_judged_are_none(
    folder: Path,
) -> None:
    assert picture_before(folder, 500.0, LOOK, now(folder)) is None  # another print's
    old = folder / "looks" / "0002" / "picture.png"
    long_ago = now(folder).stat().st_mtime - 7200
    os.utime(old, (long_ago, long_ago))
    assert picture_before(folder, 0.0, LOOK, now(folder)) is None
    os.utime(old)
    (folder / "looks" / "0002" / "look.json").unlink()
    assert picture_before(folder, 0.0, LOOK, now(folder)) is None


def test_a_picture_in_a_file_of_another_format_counts(folder: Path) -> None:
    """After PNG, TIFF of the same camera told nothing of a layer over older ink."""
    other = now(folder).with_suffix(".tif")
    other.touch()
    assert picture_before(folder, 0.0, LOOK, other) == folder / "looks/0002/picture.png"


def test_the_first_look_has_the_view_of_the_empty_dish(tmp_path: Path) -> None:
    empty, first = (look_folder(tmp_path, number) / "picture.png" for number in (EMPTY, 1))
    for number, path in enumerate((empty, first)):
        path.touch()
        os.utime(path, (1000.0 + 60.0 * number,) * 2)
    look = Look(1, 40, 40, 0, "end of layer 0")
    assert picture_before(tmp_path, 1030.0, look, first) == empty
    assert picture_before(tmp_path, 990.0, look, first) is None  # taken while it was printing
    later = Look(2, 80, 80, 40, "end of layer 1")
    assert picture_before(tmp_path, 1030.0, later, first) is None


def test_mends_alone_are_judged_by_the_picture_before_the_ink_they_belong_to(folder: Path) -> None:
    about = Look(3, 220, 200, 100, "end of layer 1")
    assert picture_before(folder, 0.0, about, now(folder)) == folder / "looks/0001/picture.png"


COLOUR = np.random.default_rng(1).integers(0, 255, (20, 30, 3), dtype=np.uint8)


def before_in(folder: Path, image: np.ndarray) -> None:
    cv2.imwrite(str(folder / "looks/0002/picture.png"), image)
    now(folder).touch()


@pytest.mark.parametrize(
    ("now_is", "words"),
    [
        (COLOUR[:, :, 0], "grey with 8 bits, and the one before was in colour with 8 bits a"),
        (COLOUR.astype(np.uint16) * 257, "in colour with 16 bits a channel, and the one before"),
    ],
)
def test_a_camera_that_changes_colour_or_depth_in_mid_print_is_told(
    folder: Path, now_is: np.ndarray, words: str
) -> None:
    """Sound ink seemed to be missing then: 4.6 mm of gaps, later a clogged needle."""
    before_in(folder, COLOUR)
    with pytest.raises(DeviceError, match=words):
        image_before(folder, 0.0, LOOK, now(folder), now_is)
