"""Refuse pictures of a camera whose frame doesn't hold any more."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from printctl.observe.devices import DeviceError
from registration.devices.camera_frame.check import check_frame
from registration.devices.camera_frame.frame import CameraFrame
from registration.errors import PictureError

_REMEDY: Final = "printctl observe frame"
_BLACK: Final = 0.02
"""Of the range, below which the brightest pixel shows no scene."""


def frame_holds(image: NDArray[Any] | None, frame: object) -> bool:
    """Whether marks in an earlier picture tell that a camera's frame held for it, too.

    False for other frames, and where a frame was fitted anew in between.
    """
    if image is None or not isinstance(frame, CameraFrame):
        return False
    try:
        return check_frame(image, frame).holds
    except PictureError:
        return False


def refuse_moved(image: NDArray[Any], frame: CameraFrame, path: Path) -> None:
    """Refuse a picture whose marks say that camera or insert were moved: all would seem shifted.

    Raises
    ------
    DeviceError
    """
    full = float(np.iinfo(image.dtype).max) if image.dtype.kind == "u" else 1.0
    brightest = float(image.max()) / full
    if brightest < _BLACK:
        raise DeviceError(
            f"{path} is black: its brightest pixel has {brightest:.1%} of the range; is the light "
            "on, the lens free, the camera sound?"
        )
    check = check_frame(image, frame, path)
    if not check.holds:
        why = "; ".join(check.why)
        remedy = "" if _REMEDY in why else f"; else fit it anew ({_REMEDY})"
        raise DeviceError(
            f"the camera's frame doesn't hold any more: {why}{remedy}, before the print goes on "
            "observed"
        )
