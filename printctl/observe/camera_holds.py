"""Refuse pictures of a camera whose frame doesn't hold any more."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from numpy.typing import NDArray

from printctl.observe.devices import DeviceError
from registration.camera_frame.check import check_frame
from registration.camera_frame.frame import CameraFrame

_REMEDY: Final = "printctl observe frame"


def refuse_moved(image: NDArray[Any], frame: CameraFrame, path: Path) -> None:
    """Refuse a picture whose marks say that camera or insert were moved: all would seem shifted.

    Raises
    ------
    DeviceError
    """
    check = check_frame(image, frame, path)
    if not check.holds:
        why = "; ".join(check.why)
        remedy = "" if _REMEDY in why else f"; fit it anew ({_REMEDY})"
        raise DeviceError(
            f"the camera's frame doesn't hold any more: {why}{remedy}, before the print goes on "
            "observed"
        )
