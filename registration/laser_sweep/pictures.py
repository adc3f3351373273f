"""Read the pictures of one sweep: a folder, a TIFF of several pages, or a video."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import tifffile
from numpy.typing import NDArray

from registration.errors import PictureError, ScanFileError
from registration.readers.broken_files import scan_file_errors

Image = NDArray[Any]
Reader = Callable[[], Image]

_PICTURES: Final = frozenset({".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp"})
_VIDEOS: Final = frozenset({".avi", ".mp4", ".mkv", ".mov"})
_TIFF: Final = "or cut off TIFF of pictures"
_TIFFS: Final = frozenset({".tif", ".tiff"})


def readers(path: Path) -> Iterator[Reader]:
    """Yield a function for each picture that reads it; those of files may run side by side.

    Raises
    ------
    PictureError
        When there is none; by a function, when its picture can't be read.
    """
    ending = path.suffix.lower()
    if path.is_dir():
        files = sorted(one for one in path.iterdir() if one.suffix.lower() in _PICTURES)
        if not files:
            raise PictureError(f"{path} holds no picture (PNG, TIFF, JPEG, BMP)")
        yield from (_of_file(one) for one in files)
    elif ending in _VIDEOS:
        yield from _of_video(path)
    elif ending in _TIFFS:
        yield from _of_pages(path)
    else:
        raise PictureError(
            f"{path} isn't a sweep of a laser line: give a folder of pictures, a TIFF of several "
            "pages, or a video (AVI, MP4, MKV, MOV)"
        )


def _of_file(path: Path) -> Reader:
    def read() -> Image:
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if image is None:
            raise PictureError(f"{path} can't be read as a picture; is it cut off?")
        return np.asarray(image[:, :, :3] if image.ndim == 3 else image)

    return read


def _of_pages(path: Path) -> Iterator[Reader]:
    with _opened(path) as tiff:
        count = len(tiff.pages)
    yield from (partial(_page, path, number) for number in range(count))


def _page(path: Path, number: int) -> Image:
    """A page, by a file handle of its own: pages are read side by side."""
    with _opened(path) as tiff:
        image = tiff.pages[number].asarray()
    return np.asarray(image if image.ndim == 2 else image[:, :, 2::-1])


@contextmanager
def _opened(path: Path) -> Iterator[tifffile.TiffFile]:
    try:
        with scan_file_errors(path, _TIFF), tifffile.TiffFile(path, _multifile=False) as tiff:
            yield tiff
    except ScanFileError as exc:  # whatever a decoder trips over, too
        raise PictureError(str(exc)) from exc


def _of_video(path: Path) -> Iterator[Reader]:
    video = cv2.VideoCapture(str(path))
    try:
        if not video.isOpened():
            raise PictureError(f"{path} can't be read as a video; give a folder of pictures")
        while True:
            there, image = video.read()
            if not there:
                return
            yield partial(np.asarray, image)
    finally:
        video.release()
