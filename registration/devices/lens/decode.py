"""Read a PNG, TIFF, JPEG or BMP picture as an array of blue, green and red."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from registration.errors import PictureError

_LEAST_PX: Final = 100


def decoded(path: Path) -> NDArray[Any]:
    """Read a picture (PNG, TIFF, JPEG, BMP; 8 or 16 bits), (h, w, 3): blue, green, red.

    Raises
    ------
    PictureError
        When it can't be read, or is tiny.
    """
    try:
        data = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    except OSError as exc:
        raise PictureError(f"{path} can't be read: {exc.strerror}; check the path") from exc
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    image = cv2.imdecode(data, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH) if len(data) else None
    if image is None:
        raise PictureError(f"{path} isn't a picture that OpenCV reads; give PNG, TIFF or JPEG")
    if min(image.shape[:2]) < _LEAST_PX:
        raise PictureError(
            f"{path}: {image.shape[1]} x {image.shape[0]} px is too small to measure in; take a "
            "picture with more pixels"
        )
    return np.asarray(image)
