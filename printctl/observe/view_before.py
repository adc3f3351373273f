"""Find the picture of an earlier look, which shows the dish before the new ink."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

from printctl.observe.devices import DeviceError, picture_of
from printctl.observe.look_values import Look
from printctl.observe.records import LOOKS, read_looks
from printctl.observe.views import Image, read_picture

EMPTY: Final = 0
"""Number of the look whose folder holds the view before anything was written."""
_OLDEST_S: Final = 3600.0
"""A picture that is older shows ink and bath as they were before they dried."""


def picture_before(folder: Path, begun: float, look: Look, now: Path) -> Path | None:
    """Return the picture that was taken before the ink of a look; None where there is none.

    It is that of the last look which was judged where the ink begins (``look.before``). The first
    look's is the one by which the device was tried, if that was before the print began.

    Parameters
    ----------
    folder : Path
        The print's.
    begun : float, s since 1970
        Of the print: what earlier prints left in the folder isn't of it.
    look : Look
    now : Path
        The picture that is to be judged; its file may be of another format.
    """
    looks = read_looks(folder, begun)
    judged = [one for one in looks if one.judged and one.number < look.number]
    there = [one.number for one in judged if one.done == look.before]
    if not there and look.before > 0:
        return None
    number, latest = (there[-1], math.inf) if there else (EMPTY, begun)
    path = picture_of(folder / LOOKS / f"{number:04d}", "picture")
    if path is None:
        return None
    try:
        taken = path.stat().st_mtime
        age = now.stat().st_mtime - taken
    except OSError:
        return None
    return path if 0.0 <= age < _OLDEST_S and taken <= latest else None


def image_before(folder: Path, begun: float, look: Look, now: Path, image: Image) -> Image | None:
    """Return `picture_before`, read; None where there is none, or it shows another view.

    Parameters
    ----------
    image : Image
        The picture that is to be judged.

    Raises
    ------
    DeviceError
        When the two differ in colour or depth: ink as one tells it isn't known in the other.
    """
    earlier = picture_before(folder, begun, look, now)
    if earlier is None:
        return None
    try:
        before = read_picture(earlier)
    except DeviceError:
        return None
    if _kind(before) != _kind(image):
        raise DeviceError(
            f"the picture is {_kind(image)}, and the one before was {_kind(before)}: ink can't be "
            "compared in them; set the camera as before, then resume"
        )
    return before if before.shape == image.shape else None


def _kind(image: Image) -> str:
    """Colour and depth of a picture, in words."""
    colour = "grey" if image.ndim == 2 else "in colour"
    depth = 8 * image.dtype.itemsize
    return f"{colour} with {depth} bits{'' if image.ndim == 2 else ' a channel'}"
