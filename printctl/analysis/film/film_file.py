"""Write a film file in its suffix's format: MP4 and the like by OpenCV, GIF, WebP by Pillow."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from design.files import atomic_replacement
from printctl.errors import UsageError
from sim.devices.dye.film import CODES, write_frames

SUFFIXES: Final = (*CODES, ".gif", ".webp")

Frame = NDArray[np.uint8]
_QUALITY: Final = 80


def check_suffix(path: Path) -> None:
    """Raise `UsageError` when a film can't be written under this name."""
    if path.suffix.lower() not in SUFFIXES or path.is_dir():
        raise UsageError(f"{path}: give the name of a film, ending in {', '.join(SUFFIXES)}")


def write_film(path: Path, frames: Iterator[Frame], fps: float) -> int:
    """Write frames (height, width, 3), red, green, blue, of one size; how many there were.

    Raises
    ------
    UsageError
        As `check_suffix`.
    SimError, OSError
        When the file can't be written.
    """
    check_suffix(path)
    first = next(frames)
    every = chain([first], frames)
    if path.suffix.lower() in CODES:
        count = 0

        def counted() -> Iterator[Frame]:
            nonlocal count
            for frame in every:
                count += 1
                yield np.ascontiguousarray(frame[:, :, ::-1])

        write_frames(path, counted(), (first.shape[1], first.shape[0]), fps)
        return count
    return _animated(path, [Image.fromarray(frame) for frame in every], fps)


def _animated(path: Path, images: list[Image.Image], fps: float) -> int:
    """An animated picture that begins anew at its end."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix.lower() == ".gif":
        # One palette for all frames, of those that show most: the last.
        palette = images[-1].quantize(256, Image.Quantize.MEDIANCUT)
        images = [one.quantize(palette=palette, dither=Image.Dither.NONE) for one in images]
    with atomic_replacement(path) as draft:
        images[0].save(
            draft,
            format=path.suffix[1:].upper(),
            save_all=True,
            append_images=images[1:],
            duration=round(1000.0 / fps),
            loop=0,
            **({"quality": _QUALITY} if path.suffix.lower() == ".webp" else {"disposal": 1}),
        )
    return len(images)
