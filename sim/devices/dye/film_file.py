"""Write video frames to a film file (MP4, MOV, AVI) by OpenCV."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.errors import SimError

CODES: Final = {".mp4": "mp4v", ".mov": "mp4v", ".avi": "MJPG"}
"""Codec of each suffix."""


def write_frames(
    path: Path, frames: Iterable[NDArray[np.uint8]], size: tuple[int, int], fps: float
) -> None:
    """Write frames (height, width, 3; blue, green, red) of ``size`` (width, height).

    A film that breaks off leaves no file.

    Raises
    ------
    SimError
        When the suffix isn't known, or the file can't be written.
    """
    if path.suffix.lower() not in CODES:
        raise SimError(f"{path}: a film is written as {', '.join(CODES)}")
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.stem}.part{path.suffix}")
    code = cv2.VideoWriter.fourcc(*CODES[path.suffix.lower()])
    writer = cv2.VideoWriter(str(draft), code, fps, size)
    try:
        if not writer.isOpened():
            raise SimError(f"{path}: OpenCV can't write this film; try .avi")
        for frame in frames:
            writer.write(frame)
        writer.release()
        draft.replace(path)
    finally:
        writer.release()
        draft.unlink(missing_ok=True)
