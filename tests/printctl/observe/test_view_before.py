"""The picture that counts as the one before a look's layer."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from printctl.observe.devices import DeviceError
from printctl.observe.look_values import Look
from printctl.observe.records import LookRecord, look_folder, save_look
from printctl.observe.view_before import EMPTY, image_before, picture_before

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
