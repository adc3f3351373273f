"""Read the frames of a dye video with their times, by OpenCV."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from registration.errors import DyeError

Frame = NDArray[np.uint8]
FEWEST_FRAMES = 20


def film_frames(path: Path) -> Iterator[tuple[float, Frame]]:
    """Time in s and picture (height, width, 3; blue, green, red) of each frame.

    Times are the file's own for each frame; where a file has none that rise, frames are taken as
    evenly spaced at its rate.

    Raises
    ------
    DyeError
        When the file isn't there, isn't a film, or has no rate.
    """
    if not path.is_file():
        raise DyeError(f"{path} doesn't exist; give a film (.mp4, .avi, .mov)")
    # What ffmpeg has to say of a broken file is said by our message; it reads this once.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    film = cv2.VideoCapture(str(path))
    try:
        rate = float(film.get(cv2.CAP_PROP_FPS)) if film.isOpened() else 0.0
        yield from _timed(film, cv2.CAP_PROP_POS_MSEC, rate, path)
    finally:
        film.release()


def _timed(film: Any, clock: int, rate: float, path: Path) -> Iterator[tuple[float, Frame]]:
    index, last = 0, -np.inf
    while True:
        frame = film.read()[1] if film.isOpened() else None
        if frame is None:
            break
        time = float(film.get(clock)) / 1000.0
        if not time > last:
            if not rate > 0.0:
                raise DyeError(f"{path}: frames have no times and no rate; convert it to .mp4")
            time = index / rate if index == 0 else last + 1.0 / rate
        yield time, frame
        index, last = index + 1, time
    if index == 0:
        raise DyeError(f"{path}: no frame can be read; is it a film (.mp4, .avi, .mov), and whole?")
    if index < FEWEST_FRAMES:
        raise DyeError(f"{path}: {index} frames, fewer than {FEWEST_FRAMES}; film for longer")
