"""Load a picture with its camera frame, an OCT volume as a height map, or a profiler's heights."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from printctl.observe.camera_holds import refuse_moved
from printctl.observe.devices import DeviceError
from printctl.observe.order import ObserverOrder
from printctl.observe.profiler import FRAME_KEY, open_surface, read_matrix
from printctl.observe.scan_place import ScanSize, refuse_elsewhere
from registration.devices.camera_frame.frame import CameraFrame, read_frame
from registration.errors import ScanFileError
from registration.files.readers.read import read_scan
from registration.inspection import (
    ExpectedLines,
    Frame,
    HeightFrame,
    ShownLines,
    filament_map,
    height_map,
)
from registration.scan import Scan
from sim.devices.camera.optics import Camera, through_surface
from sim.devices.camera.paint import load_camera
from sim.devices.camera.scene import Bath

Image = NDArray[Any]

_PICTURES: Final = frozenset({".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp"})
_JPEG, _JPEG_DATA, _JPEG_END = b"\xff\xd8", b"\xff\xda", b"\xff\xd9"
_SECTIONS: Final = 16


@dataclass(frozen=True)
class SimulatedFrame:
    """Frame of a simulated camera, exact.

    Attributes
    ----------
    camera : Camera
    bath : Bath
        Through whose surface it looks, where it has one.
    """

    camera: Camera
    bath: Bath

    def to_pixels(self, points_mm: FloatArray) -> FloatArray:
        """Pixels (n, 2) of places (n, 3), mm."""
        surface = self.bath.surface_z_mm
        if surface is None:
            return self.camera.pixels(points_mm)
        index = self.bath.refractive_index
        at = through_surface(points_mm, self.camera.eye_mm, surface, index)
        return self.camera.pixels(np.column_stack([at, np.full(len(at), surface)]))


class View(NamedTuple):
    """What a device gave, as it is judged.

    Attributes
    ----------
    image : Image
        A picture, or the height map of a volume at the layer that is looked at.
    frame : Frame
        Where the printer's places lie in it.
    taken : array
        The picture, or some sections of the volume at all depths: those of the next layer's look
        differ where the device works, though its height map does in any case.
    size : ScanSize or None
        Of a volume or height map.
    hidden : (rows, columns) bool or None
        What a profiler didn't see.
    shown : Image or None
        To draw findings into, where that isn't the image itself.
    filaments : Image or None
        Of a volume in a bath: each column at the depth of the filament that is expected next to it.
    scan : Scan or None
        A volume in a bath.
    thickness_mm : float, mm
        Of the layer in a height map; NaN of others.
    """

    image: Image
    frame: Frame
    taken: Image
    size: ScanSize | None = None
    hidden: NDArray[np.bool_] | None = None
    shown: Image | None = None
    filaments: Image | None = None
    scan: Scan | None = None
    thickness_mm: float = math.nan

    @property
    def drawn_into(self) -> Image:
        """Picture that findings are drawn into."""
        return self.image if self.shown is None else self.shown

    def shown_lines(self, lines: ExpectedLines) -> ShownLines:
        """Lines without older ones that a volume in a bath doesn't show where they lie."""
        if self.scan is None or not lines.fresh.any():
            return ShownLines(lines, np.arange(len(lines)))
        assert isinstance(self.frame, HeightFrame)
        return ShownLines.of(lines, self.frame, self.scan.depth_down)


def open_view(
    path: Path,
    order: ObserverOrder,
    middle_z_mm: float,
    thickness_mm: float,
    lines: ExpectedLines | None = None,
) -> View:
    """Return a picture, or a volume's height map, and where the printer's places lie in it.

    Parameters
    ----------
    path : Path
        A picture, or a scan in any format that registration reads.
    order : ObserverOrder
        Names the frame's file.
    middle_z_mm, thickness_mm : float, mm
        Of the layer that is looked at; of a volume that slab counts.
    lines : ExpectedLines or None
        By which a volume's ink and bath are told apart; a height map needs them.

    Raises
    ------
    DeviceError
        When the file is neither, shows that camera or insert were moved, or is a volume of
        another place than the lines.
    UsageError
        When the frame can't be read.
    """
    if order.laser and lines is not None:
        surface, size, heights = open_surface(path, order.frame, middle_z_mm, thickness_mm, lines)
        return View(
            surface.picture, surface.frame, heights.height_mm, size, surface.hidden,
            surface.shaded(), thickness_mm=thickness_mm,
        )  # fmt: skip
    if order.oct:
        to_scan = _oct_frame(path, order)
        try:
            scan = read_scan(path)
        except ScanFileError as exc:
            raise DeviceError(" ".join(str(exc).split())) from exc
        if lines is not None:
            refuse_elsewhere(ScanSize.of(scan, to_scan), lines)
        image, height_frame = height_map(scan, to_scan, middle_z_mm, thickness_mm, lines)
        step = max(1, len(scan.volume) // _SECTIONS)
        filaments = None
        if lines is not None and order.embedded:
            # Of filaments at all depths no height is that of the layer.
            fresh = lines.fresh.any()
            filaments = filament_map(scan, height_frame, lines) if fresh else image[:, :, :1]
        return View(
            image,
            height_frame,
            np.asarray(scan.volume[::step]),
            ScanSize.of(scan, to_scan),
            filaments=filaments,
            scan=None if filaments is None else scan,
        )
    image, frame = read_picture(path), camera_frame(order)
    if isinstance(frame, CameraFrame):
        refuse_moved(image, frame, path)
    return View(image, frame, image)


def camera_frame(order: ObserverOrder) -> Frame:
    """Return the camera's frame; a simulated camera's own where nobody calibrated it.

    One that was fitted anew in a pause counts from then on.
    """
    file = Path(order.frame)
    written = file.stat().st_mtime_ns if order.frame and file.is_file() else 0
    return _camera_frame(order.frame, written, order.device.extra.get("camera", ""))


@lru_cache(maxsize=1)
def _camera_frame(frame: str, _written: int, simulated: str) -> Frame:
    if frame:
        return read_frame(Path(frame))
    file = load_camera(Path(simulated))
    return SimulatedFrame(file.camera, file.scene.bath)


def _oct_frame(path: Path, order: ObserverOrder) -> FloatArray:
    if order.frame:
        return read_oct_frame(Path(order.frame))
    with np.load(path) as file:
        return np.asarray(file[FRAME_KEY], dtype=np.float64)


def read_oct_frame(path: Path) -> FloatArray:
    """Read a YAML file with ``printer_to_scan``, (4, 4): the printer's mm to the scan's mm.

    Raises
    ------
    UsageError
        When there is none, or it isn't a matrix.
    """
    return np.asarray(read_matrix(path, "an OCT")[FRAME_KEY])


def read_picture(path: Path) -> Image:
    """Read a picture of any depth; grey ones stay of one channel, and no alpha is kept.

    Raises
    ------
    DeviceError
        When it isn't one, or half of one.
    """
    known = path.suffix.lower() in _PICTURES
    if known and _is_cut(path):
        raise DeviceError(f"{path} is cut off: half of a picture, still being written or copied")
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if known else None
    if image is None:
        raise DeviceError(f"{path} isn't a picture that can be read (PNG, TIFF, JPEG)")
    picture = np.asarray(image)
    return picture if picture.ndim == 2 else np.ascontiguousarray(picture[:, :, :3])


def _is_cut(path: Path) -> bool:
    """Whether a JPEG lacks its end; OpenCV fills up what is missing with grey.

    Within the picture's data neither marker occurs; a small preview lies before them.
    """
    data = path.read_bytes() if path.suffix.lower() in (".jpg", ".jpeg") else b""
    return data.startswith(_JPEG) and data.rfind(_JPEG_END) < data.rfind(_JPEG_DATA)
