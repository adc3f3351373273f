"""Encode a time-lapse's pictures as an animated WebP video.

Runs as a process of its own (``python -m printctl.web.job.camera.film FOLDER FILM``): a long film
takes a minute of a processor.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from PIL import Image

from design.files import atomic_replacement
from printctl.web.worker import lower_priority

MOST_FRAMES: Final = 600
LONGEST_PX: Final = 960
_FRAME_MS: Final = 100
_LAST_MS: Final = 2000
_QUALITY: Final = 70
_BEHIND_THE_PRINT: Final = 15


class _Frames(Image.Image):
    """Pictures of one size as the frames of an image, each read when its turn comes."""

    def __init__(self, paths: Sequence[Path]) -> None:
        super().__init__()
        self._paths = paths
        self.n_frames = len(paths)
        first = _small(paths[0], None)
        self._mode, self._size = first.mode, first.size
        self.im = first.im

    def seek(self, frame: int) -> None:
        """Go to a picture."""
        self.im = _small(self._paths[frame], self.size).im


def write_film(folder: Path, film: Path) -> int:
    """Make a WebP film of a folder's pictures; of more than 600 it takes them evenly.

    Return the number of pictures in it; 0, and no film, where fewer than two can be read.
    """
    paths = [path for path in sorted(folder.glob("*.jpg")) if _readable(path)]
    if len(paths) > MOST_FRAMES:
        last = len(paths) - 1
        paths = [paths[round(k * last / (MOST_FRAMES - 1))] for k in range(MOST_FRAMES)]
    if len(paths) < 2:
        return 0
    times = [_FRAME_MS] * (len(paths) - 1) + [_LAST_MS]
    with atomic_replacement(film) as draft:
        _Frames(paths).save(
            draft, "WEBP", save_all=True, duration=times, loop=0, quality=_QUALITY, method=2
        )
    return len(paths)


def _small(path: Path, size: tuple[int, int] | None) -> Image.Image:
    """A picture no larger than the film, or of the film's size."""
    with Image.open(path, formats=("JPEG",)) as read:
        picture = read.convert("RGB")
    if size is None:
        picture.thumbnail((LONGEST_PX, LONGEST_PX))
        return picture
    return picture if picture.size == size else picture.resize(size)


def _readable(path: Path) -> bool:
    try:
        with Image.open(path, formats=("JPEG",)) as read:
            read.verify()
    except (OSError, SyntaxError):
        return False
    return True


if __name__ == "__main__":
    lower_priority(_BEHIND_THE_PRINT)
    write_film(Path(sys.argv[1]), Path(sys.argv[2]))
