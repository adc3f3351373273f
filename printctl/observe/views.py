"""Load a look's picture, OCT volume or profiler heights with a valid camera frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from firmware_profiles.yaml_file import read_yaml
from kernels.arrays import FloatArray
from printctl.errors import UsageError
from printctl.observe.devices import DeviceError
from printctl.observe.order import ObserverOrder
from printctl.observe.scan_place import ScanSize, refuse_elsewhere
from registration.devices.camera_frame.check import check_frame
from registration.devices.camera_frame.frame import CameraFrame, read_frame
from registration.devices.laser_sweep import is_laser_file, read_laser, sweep_heights, trace
from registration.errors import PictureError, ScanFileError
from registration.files.readers.heights import HeightMap, read_heights, wrong_placement
from registration.files.readers.read import read_scan
from registration.inspection import (
    ExpectedLines,
    Frame,
    HeightFrame,
    ShownLines,
    Surface,
    filament_map,
    height_map,
    surface_of,
)
from registration.scan import Scan
from sim.devices.camera.optics import Camera, through_surface
from sim.devices.camera.paint import load_camera
from sim.devices.camera.scene import Bath

# Refuse pictures of a camera whose frame doesn't hold any more.

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


# Load a profiler's heights, or a camera's sweep of a laser line, as a layer's surface.

FRAME_KEY: Final = "printer_to_scan"
"""Where a frame's file, and a simulated device's own, hold the matrix."""
_ASIDE_MM: Final = 2.0
"""Heights are laid out so far beyond the lines."""
_HIGHEST: Final = 1.5
"""Layers over a layer's top, from which on heights are of something else."""
_FLATTEST, _TALLEST = 0.3, 2.0
"""Times a layer's height, that its lines stand over the plate: a needle fixes it, and lines of
slumped or domed ink stood 0.75 to 1.0 over it."""
_SHOWS: Final = 0.5
"""Of the way, with ink on it, from which on what stands there is ink."""
_KEYS: Final = frozenset({FRAME_KEY, "pixel_mm", "count_mm", "lost", "size"})


@dataclass(frozen=True)
class ProfilerFrame:
    """What a profiler's files don't say themselves.

    Attributes
    ----------
    to_map : (4, 4) float64
        Takes the printer's places to the profiler's, mm.
    pixel_mm : (x, y) or None, mm
    count_mm : float, mm
    lost : float or None
        These three as of `read_heights`.
    size : (x, y) or None
        Columns and rows of a whole map.
    """

    to_map: FloatArray
    pixel_mm: tuple[float, float] | None = None
    count_mm: float = 1.0
    lost: float | None = None
    size: tuple[int, int] | None = None


def read_matrix(path: Path, device: str, known: frozenset[str] | None = None) -> dict[str, Any]:
    """Read a frame's YAML file with ``printer_to_scan``, as a (4, 4) array; other keys as they are.

    Raises
    ------
    UsageError
        When there is none, it isn't a matrix that can be undone, or a key isn't ``known``.
    """
    try:
        data = dict(read_yaml(path.read_text(encoding="utf-8")))
        matrix = np.array(data[FRAME_KEY], dtype=float)
    except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError) as exc:
        raise UsageError(
            f"observe.frame {path} can't be read ({exc}); for {device} it is a YAML file with "
            f"{FRAME_KEY}: four rows of four numbers, mm"
        ) from exc
    if wrong := wrong_placement(matrix):
        raise UsageError(f"observe.frame {path}: {FRAME_KEY} {wrong}")
    if known is not None and (strange := sorted(set(data) - known)):
        raise UsageError(
            f"observe.frame {path}: {', '.join(strange)} means nothing; known are "
            f"{', '.join(sorted(known))}"
        )
    return {**data, FRAME_KEY: matrix}


def read_profiler_frame(path: Path) -> ProfilerFrame:
    """Read a laser profiler's frame.

    Raises
    ------
    UsageError
        When it can't be read, or a value isn't what it must be.
    """
    data = read_matrix(path, "a laser profiler", _KEYS)
    try:
        pixel = data.get("pixel_mm")
        if pixel is not None:
            x, y = (float(one) for one in pixel)
            pixel = (x, y)
        count, lost = float(data.get("count_mm", 1.0)), data.get("lost")
        lost = None if lost is None else float(lost)
    except (TypeError, ValueError) as exc:
        raise UsageError(
            f"observe.frame {path}: pixel_mm is two numbers [x, y], count_mm and lost are one each"
        ) from exc
    if not all(0 < one < np.inf for one in (count, *(pixel or ()))):
        raise UsageError(f"observe.frame {path}: pixel_mm and count_mm must be above 0 mm")
    return ProfilerFrame(data[FRAME_KEY], pixel, count, lost, _size(path, data.get("size")))


def _size(path: Path, value: Any) -> tuple[int, int] | None:
    """Columns and rows of a whole map, where its frame says them."""
    if value is None:
        return None
    good = isinstance(value, list) and len(value) == 2
    if not good or not all(type(one) is int and one >= 16 for one in value):
        raise UsageError(
            f"observe.frame {path}: size is {value!r}; it is [columns, rows] of a whole height "
            "map, whole numbers of 16 and more"
        )
    return value[0], value[1]


def try_laser_frame(path: Path) -> None:
    """Read the frame of a profiler, or of a laser line with a camera.

    Raises
    ------
    UsageError, PictureError
        When it can't be read.
    """
    if is_laser_file(path):
        read_laser(path)
    else:
        read_profiler_frame(path)


def open_surface(
    path: Path,
    frame_file: str,
    middle_z_mm: float,
    thickness_mm: float,
    lines: ExpectedLines,
) -> tuple[Surface, ScanSize, HeightMap]:
    """Return a layer's surface, how large the height map is, and the map as it was read.

    Parameters
    ----------
    path : Path
    frame_file : str
        Path of the profiler's frame, or of `printctl observe sweep`; empty for a simulated
        profiler's own.
    middle_z_mm, thickness_mm : float, mm
        Of the layer that is looked at.
    lines : ExpectedLines

    Raises
    ------
    DeviceError
        When it can't be read, measured nothing, holds another place than the lines, stands far
        over the layer, or shows that the camera or the insert was moved.
    UsageError
        When the frame can't be read.
    """
    if frame_file and is_laser_file(Path(frame_file)):
        heights, to_map, whole = _swept(path, Path(frame_file), lines), np.eye(4), None
    else:
        heights, to_map, whole = _read(path, frame_file)
    size = replace(ScanSize.of_heights(heights, to_map), whole=whole)
    refuse_elsewhere(size, lines)
    try:
        surface = surface_of(heights, to_map, middle_z_mm, thickness_mm, lines)
    except PictureError as exc:
        raise DeviceError(f"{path}: {exc}") from exc
    over = f"{1000.0 * surface.over_mm:+.0f} µm over the layer's top along the lines"
    if surface.over_mm > _HIGHEST * thickness_mm:
        raise DeviceError(
            f"the map lies {over}, more than {_HIGHEST:g} of its layers of "
            f"{1000.0 * thickness_mm:.0f} µm: check the heights' unit (count_mm) and the z of "
            f"{FRAME_KEY} in observe.frame, or see what covers the layer, then resume"
        )
    if np.isfinite(surface.over_mm):
        size = replace(size, words=f"{size.words}, and lies {over}")
    return surface, replace(size, stands=surface.stands_mm / thickness_mm), heights


def refuse_other_height(size: ScanSize | None, seen_share: float, coverage: float) -> None:
    """Refuse a height map in which the first layer's ink shows, but far too flat or tall.

    Parameters
    ----------
    size : ScanSize or None
    seen_share, coverage : float
        As of `LayerFindings`.

    Raises
    ------
    DeviceError
    """
    if size is None or not seen_share * coverage > _SHOWS or not math.isfinite(size.stands):
        return
    if _FLATTEST < size.stands < _TALLEST:
        return
    raise DeviceError(
        f"the lines show, but stand {size.stands:.2g} times their layer's height over the plate "
        f"beside them ({_FLATTEST:.1g} to {_TALLEST:g} may be): check the heights' unit (count_mm "
        "in observe.frame: 1 for mm, 0.001 for µm), or how far the needle is from the plate, then "
        "resume"
    )


def _read(path: Path, frame_file: str) -> tuple[HeightMap, FloatArray, tuple[int, int] | None]:
    """Heights of a file, what takes the printer's places to them, (4, 4), and a map's usual size.

    The size is in rows and columns, None where nobody said it.
    """
    frame = read_profiler_frame(Path(frame_file)) if frame_file else ProfilerFrame(np.eye(4))
    try:
        heights = read_heights(path, frame.pixel_mm, frame.count_mm, frame.lost)
    except (ScanFileError, OSError) as exc:
        raise DeviceError(" ".join(str(exc).split())) from exc
    told = None if frame_file else heights.to_map
    whole = None if frame.size is None or heights.placed else frame.size[::-1]
    return heights, frame.to_map if told is None else told, whole


def _swept(path: Path, laser_file: Path, lines: ExpectedLines) -> HeightMap:
    """Heights around the lines by a camera's pictures of a laser line, printer's frame."""
    laser = read_laser(laser_file)
    places = np.concatenate([lines.start, lines.end])[:, :2]
    try:
        traced = trace(path, laser.frame)
        refuse_moved(traced.ground, laser.frame, path)
        low, high = places.min(axis=0) - _ASIDE_MM, places.max(axis=0) + _ASIDE_MM
        return sweep_heights(traced, laser, low, high)
    except PictureError as exc:
        raise DeviceError(" ".join(str(exc).split())) from exc


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
