"""Render slices of a scan as pictures: windowed, with a threshold tint."""

from __future__ import annotations

import io
import threading
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from printctl.web.errors import BadRequestError
from printctl.web.workspace import Stamp, stamp
from registration.files.readers import read_scan
from registration.scan import Scan

Axis = Literal["x", "y", "z"]
TINT: Final = (255, 140, 0)
"""Of what is above the threshold, mixed half and half."""

_SAMPLES: Final = 2_000_000
"""Voxels, evenly spread, by which window and threshold are chosen."""


@dataclass(frozen=True)
class Volume:
    """What is known of a scan's volume, along x, y, z.

    Attributes
    ----------
    voxel_um, size_mm : (float, float, float)
        Geometric.
    refractive_index : float
        By which depth was divided; 1 where depth isn't optical.
    depth_down : bool
        Whether growing depth index goes down into the sample.
    notes : tuple of str
        What was done to it as it was read.
    low, high : float
        Of the intensity: the window to begin with, from 1 to 98.5 % of the voxels.
    threshold : float
        Between the two classes of voxels (Otsu 1979).
    """

    shape: tuple[int, int, int]
    voxel_um: tuple[float, float, float]
    size_mm: tuple[float, float, float]
    modality: str
    scale: str
    refractive_index: float
    depth_down: bool
    notes: tuple[str, ...]
    low: float
    high: float
    threshold: float


def describe(scan: Scan) -> Volume:
    """Describe a scan, with a window and a threshold to begin with."""
    from skimage.filters import threshold_otsu  # slow to load: only for who opens a scan

    step = max(1, int(np.ceil((scan.volume.size / _SAMPLES) ** (1 / 3))))
    values = np.asarray(scan.volume[::step, ::step, ::step], dtype=np.float64)
    values = values[np.isfinite(values)] if np.isfinite(values).any() else np.zeros(1)
    low, high = (float(one) for one in np.quantile(values, (0.01, 0.985)))
    nz, ny, nx = scan.volume.shape
    dz, dy, dx = scan.geometric_voxel_mm
    return Volume(
        shape=(nx, ny, nz),
        voxel_um=(dx * 1e3, dy * 1e3, dz * 1e3),
        size_mm=(nx * dx, ny * dy, nz * dz),
        modality=scan.modality,
        scale=scan.scale,
        refractive_index=scan.refractive_index,
        depth_down=scan.depth_down,
        notes=scan.notes,
        low=low,
        high=high if high > low else low + 1.0,
        threshold=float(threshold_otsu(values)),  # the value itself where there is only one
    )


def picture(
    image: NDArray[Any], low: float, high: float, threshold: float | None
) -> NDArray[np.uint8]:
    """Grey values of a slice, (h, w, 3); `low` is black, `high` white.

    Raises
    ------
    BadRequestError
        When the window is empty.
    """
    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        raise BadRequestError(f"the window goes from {low:g} to {high:g}; let it rise")
    values = np.nan_to_num(np.asarray(image, dtype=np.float64), nan=low)
    grey = np.clip((values - low) / (high - low), 0.0, 1.0) * 255.0
    rgb = np.repeat(np.rint(grey)[..., None], 3, axis=2)
    if threshold is not None:
        above = values >= threshold
        rgb[above] = (rgb[above] + np.array(TINT)) / 2
    return rgb.astype(np.uint8)


def open_scan(path: Path) -> tuple[Scan, Volume]:
    """Read a scan, unless it is one of the last two and neither it nor its sidecar has changed.

    Raises
    ------
    ScanFileError
        When it can't be read, or doesn't say what it must.
    """
    with _LOCK:
        return _opened(path, _state(path))


def slice_png(
    path: Path,
    axis: Axis,
    index: int,
    window: tuple[float, float] | None = None,
    threshold: float | None = None,
) -> bytes:
    """Return one slice as a PNG file; rows are z (or y, seen along z), columns x (or y, along x).

    Raises
    ------
    BadRequestError
        For an index outside, or an empty ``window`` of intensity.
    ScanFileError
    """
    with _LOCK:
        return _drawn(path, _state(path), axis, index, window, threshold)


_LOCK: Final = threading.Lock()
"""No scan is read twice at once."""


@lru_cache(maxsize=2)
def _opened(path: Path, state: tuple[Stamp, ...]) -> tuple[Scan, Volume]:
    scan = read_scan(path)
    return scan, describe(scan)


@lru_cache(maxsize=400)
def _drawn(
    path: Path,
    state: tuple[Stamp, ...],
    axis: Axis,
    index: int,
    window: tuple[float, float] | None,
    threshold: float | None,
) -> bytes:
    scan, known = _opened(path, state)
    number = "zyx".index(axis)
    count = scan.volume.shape[number]
    if not 0 <= index < count:
        raise BadRequestError(f"slice {index} lies outside 0 to {count - 1} along {axis}")
    image, out = np.take(scan.volume, index, axis=number), io.BytesIO()
    pixels = picture(image, *(window or (known.low, known.high)), threshold)
    Image.fromarray(pixels).save(out, "PNG", compress_level=1)
    return out.getvalue()


def _state(path: Path) -> tuple[Stamp, ...]:
    """Changes when the scan, or what is said of it, does."""
    places = [path, *(path.with_suffix(suffix) for suffix in (".json", ".yaml", ".yml"))]
    return tuple(stamp(one) for one in places if one.exists())
