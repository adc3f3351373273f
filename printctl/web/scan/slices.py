"""Render slices of a scan as pictures: windowed, with a threshold tint."""

from __future__ import annotations

import io
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from printctl.web.errors import BadRequestError
from registration.files.readers import read_scan
from registration.scan import Scan

Axis = Literal["x", "y", "z"]
AXES: Final[dict[Axis, int]] = {"z": 0, "y": 1, "x": 2}

TINT: Final = (255, 140, 0)
"""Of what is above the threshold, mixed half and half."""

_SAMPLES: Final = 2_000_000
_KEPT_SCANS: Final = 2
_KEPT_PICTURES: Final = 400


@dataclass(frozen=True)
class OpenScan:
    """A scan that is looked at.

    Attributes
    ----------
    scan : Scan
    low, high : float
        Of the intensity: the window to begin with, from 1 to 98.5 % of the voxels.
    threshold : float
        Between the two classes of voxels (Otsu 1979).
    """

    scan: Scan
    low: float
    high: float
    threshold: float

    @property
    def size_mm(self) -> tuple[float, float, float]:
        """Along x, y, z."""
        dz, dy, dx = self.scan.geometric_voxel_mm
        nz, ny, nx = self.scan.volume.shape
        return (nx * dx, ny * dy, nz * dz)


@dataclass(frozen=True)
class Volume:
    """What is known of a scan's volume.

    Attributes
    ----------
    shape : (int, int, int)
        Voxels along x, y, z.
    voxel_um, size_mm : (float, float, float)
        Along x, y, z; geometric.
    modality, scale : str
    refractive_index : float
        By which depth was divided; 1 where depth isn't optical.
    depth_down : bool
        Whether growing depth index goes down into the sample.
    notes : tuple of str
        What was done to it as it was read.
    low, high : float
        Of the intensity: the window to begin with.
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


def volume_of(opened: OpenScan) -> Volume:
    """Describe a scan that was read."""
    scan = opened.scan
    nz, ny, nx = scan.volume.shape
    dz, dy, dx = scan.geometric_voxel_mm
    return Volume(
        shape=(nx, ny, nz),
        voxel_um=(dx * 1e3, dy * 1e3, dz * 1e3),
        size_mm=opened.size_mm,
        modality=scan.modality,
        scale=scan.scale,
        refractive_index=scan.refractive_index,
        depth_down=scan.depth_down,
        notes=scan.notes,
        low=opened.low,
        high=opened.high,
        threshold=opened.threshold,
    )


def open_scan(scan: Scan) -> OpenScan:
    """A scan with a window and a threshold to begin with."""
    values = sample(scan.volume)
    low, high = (float(one) for one in np.quantile(values, (0.01, 0.985)))
    high = high if high > low else low + 1.0
    return OpenScan(scan, low, high, _threshold(values))


def sample(volume: NDArray[Any]) -> NDArray[np.float64]:
    """About two million voxels, evenly spread, float64; what isn't finite is left out."""
    step = max(1, int(np.ceil((volume.size / _SAMPLES) ** (1 / 3))))
    values = np.asarray(volume[::step, ::step, ::step], dtype=np.float64).reshape(-1)
    finite: NDArray[np.float64] = values[np.isfinite(values)]
    return finite if len(finite) else np.zeros(1)


def _threshold(values: NDArray[np.float64]) -> float:
    """Otsu's threshold; the value itself where there is only one."""
    from skimage.filters import threshold_otsu  # slow to load: only for who opens a scan

    return float(threshold_otsu(values))


def plane(volume: NDArray[Any], axis: Axis, index: int) -> NDArray[Any]:
    """One slice; rows are z (or y, seen along z), columns x (or y, seen along x).

    Raises
    ------
    BadRequestError
        For an index outside.
    """
    count = volume.shape[AXES[axis]]
    if not 0 <= index < count:
        raise BadRequestError(f"slice {index} lies outside 0 to {count - 1} along {axis}")
    return np.take(volume, index, axis=AXES[axis])


def picture(
    image: NDArray[Any], low: float, high: float, threshold: float | None = None
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


def as_png(pixels: NDArray[np.uint8]) -> bytes:
    """A PNG file of pixels (h, w, 3)."""
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "PNG", compress_level=1)
    return out.getvalue()


class Slices:
    """Keeps the last scans open, and their last pictures."""

    def __init__(self) -> None:
        self._scans: OrderedDict[tuple[Any, ...], OpenScan] = OrderedDict()
        self._pictures: OrderedDict[tuple[Any, ...], bytes] = OrderedDict()
        self._lock = threading.Lock()

    def open(self, path: Path) -> OpenScan:
        """Read a scan, unless it is open.

        Raises
        ------
        ScanFileError
            When it can't be read, or doesn't say what it must.
        """
        return self._kept(
            self._scans, _KEPT_SCANS, _state(path), lambda: open_scan(read_scan(path))
        )

    def png(
        self,
        path: Path,
        axis: Axis,
        index: int,
        window: tuple[float, float] | None = None,
        threshold: float | None = None,
    ) -> bytes:
        """One slice as a PNG file.

        Raises
        ------
        BadRequestError, ScanFileError
        """
        opened = self.open(path)
        low, high = window or (opened.low, opened.high)

        def draw() -> bytes:
            image = plane(opened.scan.volume, axis, index)
            return as_png(picture(image, low, high, threshold))

        key = (*_state(path), axis, index, low, high, threshold)
        return self._kept(self._pictures, _KEPT_PICTURES, key, draw)

    def _kept(
        self,
        store: OrderedDict[tuple[Any, ...], Any],
        most: int,
        key: tuple[Any, ...],
        make: Callable[[], Any],
    ) -> Any:
        with self._lock:
            if key not in store:
                store[key] = make()
                while len(store) > most:
                    store.popitem(last=False)
            store.move_to_end(key)
            return store[key]


def _state(path: Path) -> tuple[Any, ...]:
    """Changes when the scan, or what is said of it, does."""
    places = [path, *(path.with_suffix(suffix) for suffix in (".json", ".yaml", ".yml"))]
    return tuple(
        (str(one), one.stat().st_mtime_ns, one.stat().st_size) for one in places if one.exists()
    )
