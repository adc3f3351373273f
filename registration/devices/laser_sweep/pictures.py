"""Read the pictures of one sweep: a folder, a TIFF of several pages, or a video."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import tifffile
from numpy.typing import NDArray

from registration.errors import PictureError, ScanFileError
from registration.files.readers.common import scan_file_errors

Image = NDArray[Any]
Reader = Callable[[], Image]

_PICTURES: Final = frozenset({".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp"})
_VIDEOS: Final = frozenset({".avi", ".mp4", ".mkv", ".mov"})
_TIFF: Final = "or cut off TIFF of pictures"
_TIFFS: Final = frozenset({".tif", ".tiff"})


@contextmanager
def sweep_pictures(path: Path) -> Iterator[Iterable[Reader]]:
    """Open a sweep: a function for each picture, that reads it; those of files side by side.

    They can be gone through again, and hold until the sweep is left.

    Raises
    ------
    PictureError
        When there is none, or a picture can't be read; by a function, too.
    """
    ending = path.suffix.lower()
    if path.is_dir():
        files = sorted(one for one in path.iterdir() if one.suffix.lower() in _PICTURES)
        if not files:
            raise PictureError(f"{path} holds no picture (PNG, TIFF, JPEG, BMP)")
        yield [_of_file(one) for one in files]
    elif ending in _VIDEOS:
        yield _Video(path)
    elif ending in _TIFFS:
        with _opened(path) as pages:
            yield pages
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


@contextmanager
def _opened(path: Path) -> Iterator[list[Reader]]:
    """Functions that read a TIFF's pages.

    Page by page alone would go through the file up to each one's place.
    """
    with ExitStack() as stack:
        with _errors(path):
            tiff = stack.enter_context(tifffile.TiffFile(path, _multifile=False))
            tiff.filehandle.set_lock(True)  # pages are read side by side
            pages = [tiff.pages[number] for number in range(len(tiff.pages))]
        yield [partial(_page, path, page) for page in pages]


def _page(path: Path, page: tifffile.TiffPage | tifffile.TiffFrame) -> Image:
    with _errors(path):
        image = page.asarray()
    return np.asarray(image if image.ndim == 2 else image[:, :, 2::-1])


@contextmanager
def _errors(path: Path) -> Iterator[None]:
    try:
        with scan_file_errors(path, _TIFF):
            yield
    except ScanFileError as exc:  # whatever a decoder trips over, too
        raise PictureError(str(exc)) from exc


@dataclass(frozen=True)
class _Video:
    """Pictures of a video, which come one after the other."""

    path: Path

    def __iter__(self) -> Iterator[Reader]:
        video = cv2.VideoCapture(str(self.path))
        try:
            if not video.isOpened():
                raise PictureError(
                    f"{self.path} can't be read as a video; give a folder of pictures"
                )
            while True:
                there, image = video.read()
                if not there:
                    return
                yield partial(np.asarray, image)
        finally:
            video.release()
