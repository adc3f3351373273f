"""Open a look's picture, OCT volume or height map with a valid frame; find the picture before."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from printctl.inspection import (
    ExpectedLines,
    Frame,
    HeightFrame,
    VisibleLines,
    filament_map,
    height_map,
    surface_of,
)
from printctl.observe.devices import DeviceError, find_picture
from printctl.observe.looks.height_maps import (
    FRAME_KEY,
    ProfilerFrame,
    ScanSize,
    read_matrix,
    read_profiler_frame,
    refuse_elsewhere,
)
from printctl.observe.looks.look_context import Look
from printctl.observe.order import ObserverOrder
from printctl.observe.records import LOOKS_FOLDER, read_looks
from registration.devices.camera_frame.check import check_frame
from registration.devices.camera_frame.frame import CameraFrame, read_frame
from registration.devices.laser_sweep import is_laser_file, read_laser, sweep_heights, trace
from registration.errors import PictureError, ScanFileError
from registration.files.readers.heights import HeightMap, read_heights
from registration.files.readers.read import read_scan
from registration.scan import Scan
from sim.devices.camera.paint import CameraFile
from sim.devices.camera.scene import Bath, Camera, through_surface

Image = NDArray[Any]
_PICTURE_SUFFIXES: Final = frozenset({".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp"})
_JPEG, _JPEG_DATA, _JPEG_END = b"\xff\xd8", b"\xff\xda", b"\xff\xd9"
_DIGEST_SECTIONS: Final = 16
_FRAME_COMMAND: Final = "printctl observe frame"
_MIN_BRIGHTNESS: Final = 0.02
"""Of the range, below which the brightest pixel shows no scene."""
_MAP_MARGIN_MM: Final = 2.0
"""Heights are laid out so far beyond the lines."""
_MAX_OVER_LAYERS: Final = 1.5
"""Layers over a layer's top, from which on heights are of something else."""
EMPTY_LOOK_NUMBER: Final = 0
"""Number of the look whose folder holds the view before anything was written."""
_MAX_AGE_S: Final = 3600.0
"""A picture that is older shows ink and bath as they were before they dried."""


def frame_holds(image: NDArray[Any] | None, frame: object) -> bool:
    """Return whether marks in an earlier picture show that the camera's frame held for it.

    False for other frames, and where a frame was fitted anew in between.
    """
    if image is None or not isinstance(frame, CameraFrame):
        return False
    try:
        return check_frame(image, frame).holds
    except PictureError:
        return False


def refuse_moved(image: NDArray[Any], frame: CameraFrame, path: Path) -> None:
    """Refuse a black picture, or one whose marks show that camera or fiducial plate were moved.

    Raises
    ------
    DeviceError
    """
    full = float(np.iinfo(image.dtype).max) if image.dtype.kind == "u" else 1.0
    brightest = float(image.max()) / full
    if brightest < _MIN_BRIGHTNESS:
        raise DeviceError(
            f"{path} is black: its brightest pixel has {brightest:.1%} of the range; is the light "
            "on, the lens free, the camera sound?"
        )
    check = check_frame(image, frame, path)
    if not check.holds:
        why = "; ".join(check.why)
        remedy = "" if _FRAME_COMMAND in why else f"; else fit it anew ({_FRAME_COMMAND})"
        raise DeviceError(
            f"the camera's frame doesn't hold any more: {why}{remedy}, before the print goes on "
            "observed"
        )


@dataclass(frozen=True)
class SimulatedFrame:
    """Exact frame of a simulated camera.

    Attributes
    ----------
    camera : Camera
    bath : Bath
        Through whose surface it looks, where it has one.
    """

    camera: Camera
    bath: Bath

    def to_pixels(self, points_mm: FloatArray) -> FloatArray:
        """Return the pixels (n, 2) of places (n, 3), mm."""
        surface = self.bath.surface_z_mm
        if surface is None:
            return self.camera.pixels(points_mm)
        index = self.bath.refractive_index
        at = through_surface(points_mm, self.camera.eye_mm, surface, index)
        return self.camera.pixels(np.column_stack([at, np.full(len(at), surface)]))


class View(NamedTuple):
    """Picture, volume or height map of a look with its frame.

    Attributes
    ----------
    image : Image
        A picture, or the height map of a volume at the layer that is looked at.
    frame : Frame
        Where the printer's places lie in it.
    taken : array
        The picture, the map as it was read, or some sections of the volume at all depths: those of
        the next layer's look differ where the device works, though its height map does in any case.
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

    def shown_lines(self, lines: ExpectedLines) -> VisibleLines:
        """Return lines without older ones that a volume in a bath shows elsewhere or not at all."""
        if self.scan is None or not lines.fresh.any():
            return VisibleLines(lines, np.arange(len(lines)))
        assert isinstance(self.frame, HeightFrame)
        return VisibleLines.of(lines, self.frame, self.scan.depth_down)


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
        When the file is neither, shows that camera or fiducial plate were moved, or is a volume or
        map of another place than the lines, or in another unit.
    UsageError
        When the frame can't be read.
    """
    if order.laser and lines is not None:
        return _open_map(path, order.frame, middle_z_mm, thickness_mm, lines)
    if order.oct:
        return _open_volume(path, order, middle_z_mm, thickness_mm, lines)
    image, frame = read_picture(path), camera_frame(order)
    if isinstance(frame, CameraFrame):
        refuse_moved(image, frame, path)
    return View(image, frame, image)


def _open_volume(
    path: Path,
    order: ObserverOrder,
    middle_z_mm: float,
    thickness_mm: float,
    lines: ExpectedLines | None,
) -> View:
    to_scan = _oct_frame(path, order)
    try:
        scan = read_scan(path)
    except ScanFileError as exc:
        raise DeviceError(" ".join(str(exc).split())) from exc
    size = ScanSize.from_scan(scan, to_scan)
    if lines is not None:
        refuse_elsewhere(size, lines)
    image, frame = height_map(scan, to_scan, middle_z_mm, thickness_mm, lines)
    taken = np.asarray(scan.volume[:: max(1, len(scan.volume) // _DIGEST_SECTIONS)])
    view = View(image, frame, taken, size)
    if lines is None or not order.embedded:
        return view
    # Of filaments at all depths no height is that of the layer.
    filaments = filament_map(scan, frame, lines) if lines.fresh.any() else image[:, :, :1]
    return view._replace(filaments=filaments, scan=scan)


def _open_map(
    path: Path, frame_file: str, middle_z_mm: float, thickness_mm: float, lines: ExpectedLines
) -> View:
    """Open a layer's height map of a profiler, or of a camera's sweep of a laser line."""
    if frame_file and is_laser_file(Path(frame_file)):
        heights, to_map, whole = _sweep_map(path, Path(frame_file), lines), np.eye(4), None
    else:
        heights, to_map, whole = _read_map(path, frame_file)
    size = replace(ScanSize.from_heights(heights, to_map), whole=whole)
    refuse_elsewhere(size, lines)
    try:
        surface = surface_of(heights, to_map, middle_z_mm, thickness_mm, lines)
    except PictureError as exc:
        raise DeviceError(f"{path}: {exc}") from exc
    over = f"{1000.0 * surface.over_top_mm:+.0f} µm over the layer's top along the lines"
    if surface.over_top_mm > _MAX_OVER_LAYERS * thickness_mm:
        raise DeviceError(
            f"the map lies {over}, more than {_MAX_OVER_LAYERS:g} of its layers of "
            f"{1000.0 * thickness_mm:.0f} µm: check the heights' unit (count_mm) and the z of "
            f"{FRAME_KEY} in observe.frame, or see what covers the layer, then resume"
        )
    if np.isfinite(surface.over_top_mm):
        size = replace(size, words=f"{size.words}, and lies {over}")
    size = replace(size, stands=surface.over_ground_mm / thickness_mm)
    return View(
        surface.picture, surface.frame, heights.height_mm, size, surface.hidden, surface.shaded(),
        thickness_mm=thickness_mm,
    )  # fmt: skip


def _read_map(path: Path, frame_file: str) -> tuple[HeightMap, FloatArray, tuple[int, int] | None]:
    """Read a map's heights, its frame (4, 4) from printer to map, and a map's usual size.

    The size is in rows and columns, None if not given.
    """
    frame = read_profiler_frame(Path(frame_file)) if frame_file else ProfilerFrame(np.eye(4))
    try:
        heights = read_heights(path, frame.pixel_mm, frame.count_mm, frame.lost)
    except (ScanFileError, OSError) as exc:
        raise DeviceError(" ".join(str(exc).split())) from exc
    file_frame = None if frame_file else heights.to_map
    whole = None if frame.size is None or heights.placed else frame.size[::-1]
    return heights, frame.to_map if file_frame is None else file_frame, whole


def _sweep_map(path: Path, laser_file: Path, lines: ExpectedLines) -> HeightMap:
    """Return heights around the lines from a camera's laser line pictures, printer's frame."""
    laser = read_laser(laser_file)
    places = np.concatenate([lines.start, lines.end])[:, :2]
    try:
        traced = trace(path, laser.frame)
        refuse_moved(traced.ground, laser.frame, path)
        low, high = places.min(axis=0) - _MAP_MARGIN_MM, places.max(axis=0) + _MAP_MARGIN_MM
        return sweep_heights(traced, laser, low, high)
    except PictureError as exc:
        raise DeviceError(" ".join(str(exc).split())) from exc


def camera_frame(order: ObserverOrder) -> Frame:
    """Return the camera's frame; a simulated camera's own if none was calibrated.

    One that was fitted anew in a pause counts from then on.
    """
    file = Path(order.frame)
    written = file.stat().st_mtime_ns if order.frame and file.is_file() else 0
    return _camera_frame(order.frame, written, order.device.extra.get("camera", ""))


@lru_cache(maxsize=1)
def _camera_frame(frame: str, _written: int, simulated: str) -> Frame:
    if frame:
        return read_frame(Path(frame))
    file = CameraFile.load(Path(simulated))
    return SimulatedFrame(file.camera, file.scene.bath)


def _oct_frame(path: Path, order: ObserverOrder) -> FloatArray:
    if order.frame:
        return np.asarray(read_matrix(Path(order.frame), "an OCT")[FRAME_KEY])
    with np.load(path) as file:
        return np.asarray(file[FRAME_KEY], dtype=np.float64)


def read_picture(path: Path) -> Image:
    """Read a picture of any depth; grey ones stay of one channel, and no alpha is kept.

    Raises
    ------
    DeviceError
        When it isn't one, or half of one.
    """
    known = path.suffix.lower() in _PICTURE_SUFFIXES
    if known and _is_cut(path):
        raise DeviceError(f"{path} is cut off: half of a picture, still being written or copied")
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if known else None
    if image is None:
        raise DeviceError(f"{path} isn't a picture that can be read (PNG, TIFF, JPEG)")
    picture = np.asarray(image)
    return picture if picture.ndim == 2 else np.ascontiguousarray(picture[:, :, :3])


def _is_cut(path: Path) -> bool:
    """Return whether a JPEG lacks its end, which OpenCV would fill with grey.

    Within the picture's data neither marker occurs; a small preview lies before them.
    """
    data = path.read_bytes() if path.suffix.lower() in (".jpg", ".jpeg") else b""
    return data.startswith(_JPEG) and data.rfind(_JPEG_END) < data.rfind(_JPEG_DATA)


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
    judged = [one for one in looks if one.has_judgement and one.number < look.number]
    there = [one.number for one in judged if one.done == look.before]
    if not there and look.before > 0:
        return None
    number, latest = (there[-1], math.inf) if there else (EMPTY_LOOK_NUMBER, begun)
    path = find_picture(folder / LOOKS_FOLDER / f"{number:04d}", "picture")
    if path is None:
        return None
    try:
        taken = path.stat().st_mtime
        age = now.stat().st_mtime - taken
    except OSError:
        return None
    return path if 0.0 <= age < _MAX_AGE_S and taken <= latest else None


def image_before(folder: Path, begun: float, look: Look, now: Path, image: Image) -> Image | None:
    """Return `picture_before`, read; None where there is none, or it shows another view.

    Parameters
    ----------
    image : Image
        The picture that is to be judged.

    Raises
    ------
    DeviceError
        When the two differ in colour or depth: an appearance learned in one doesn't fit both.
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
    """Return a picture's colour and depth in words."""
    colour = "grey" if image.ndim == 2 else "in colour"
    depth = 8 * image.dtype.itemsize
    return f"{colour} with {depth} bits{'' if image.ndim == 2 else ' a channel'}"
