"""Test camera sources, written by OpenCV."""

from __future__ import annotations

import io
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

BLUE, RED = (200, 20, 20), (20, 20, 200)


def sequence(folder: Path, count: int = 4, colour: tuple[int, int, int] = BLUE) -> str:
    """Pictures of one colour; the name that OpenCV reads them by."""
    folder.mkdir(exist_ok=True)
    for k in range(count):
        assert cv2.imwrite(
            str(folder / f"frames_{k:03d}.png"), np.full((240, 320, 3), colour, np.uint8)
        )
    return str(folder / "frames_%03d.png")


def seen_colour(jpeg: bytes) -> tuple[int, int, int]:
    """Red, green, blue in the middle of a picture."""
    with Image.open(io.BytesIO(jpeg)) as picture:
        middle = picture.convert("RGB").getpixel((picture.width // 2, picture.height // 2))
    assert isinstance(middle, tuple)
    return middle[0], middle[1], middle[2]
