"""Take a picture with a camera that the system knows (UVC, or an address), through OpenCV."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from printctl.observe.devices.settings import DeviceSettings

_SETTLING: Final = 8
"""First pictures are dropped: exposure and white balance settle, and buffers hold old ones."""


def take_picture(settings: DeviceSettings, out: Path) -> Path:
    """Take a picture and write it as PNG.

    Raises
    ------
    ValueError
        When the camera can't be opened, gives nothing, or another size than asked for.
    """
    import cv2  # only the process that takes a picture needs it

    source = settings.source or "0"
    camera = cv2.VideoCapture(int(source) if source.isdigit() else source)
    try:
        if not camera.isOpened():
            raise ValueError(f"camera {source} can't be opened; is it connected, and free?")
        if settings.size_px is not None:
            camera.set(cv2.CAP_PROP_FRAME_WIDTH, settings.size_px[0])
            camera.set(cv2.CAP_PROP_FRAME_HEIGHT, settings.size_px[1])
        read = False
        for _ in range(_SETTLING):
            read, image = camera.read()
    finally:
        camera.release()
    if not read or image is None:
        raise ValueError(f"camera {source} gave no picture; is another program using it?")
    size = (image.shape[1], image.shape[0])
    if settings.size_px is not None and size != settings.size_px:
        raise ValueError(
            f"camera {source} gives {size[0]} x {size[1]} px, and its lens was calibrated at "
            f"{settings.size_px[0]} x {settings.size_px[1]}; calibrate it at a size that it gives"
        )
    path = out.with_suffix(".png")
    if not cv2.imwrite(str(path), image):
        raise ValueError(f"{path} can't be written; is the disk full?")
    return path
