"""Read a raw binary volume, or raw OCT spectra, laid out by a sidecar file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.errors import ScanFileError
from registration.files.readers.common import Array, FileVolume, bytes_of, fill_volume, mapped
from registration.files.readers.fourier import WINDOWS, Spectrometer, place_of_wavelengths, profiles
from registration.files.readers.metadata import RAW_KEYS, sidecar

# Compute an OCT volume from raw spectra, by wavelengths and background given in a sidecar file.

SPECTRA_KEYS = (
    "wavelength_nm", "wavelength_polynomial_nm", "spacing_mm", "background", "dispersion", "window",
)  # fmt: skip
_LEAST_SAMPLES, _MOST_SAMPLES = 64, 16384
_MOST_TERMS = 8


@dataclass(frozen=True)
class SpectraMetadata:
    """What a sidecar says of spectra, checked.

    Attributes
    ----------
    spectrometer : Spectrometer
        Of the samples.
    voxel_mm : (dz, dy, dx), mm
        dz as optical path.
    background : (n,) float64 or None
        Subtracted from each spectrum; None for the mean of each B-scan.
    """

    spectrometer: Spectrometer
    voxel_mm: tuple[float, float, float]
    background: FloatArray | None


def volume_of_spectra(spectra: Array, metadata: SpectraMetadata, path: Path) -> FileVolume:
    """Linear intensity of spectra laid out as (B-scans, A-scans, samples)."""
    bscans, lines, samples = spectra.shape
    shape = (bscans, lines, samples // 2)
    volume = fill_volume(_profiled(spectra, metadata), shape, np.dtype(np.float32), path)
    known = {
        "axes": "yxz", "voxel_mm": metadata.voxel_mm, "modality": "oct", "scale": "linear",
        "optical_depth": True, "depth_down": True,
    }  # fmt: skip
    how = "the mean of each B-scan" if metadata.background is None else "the background given"
    note = (
        f"made from spectra of {samples} samples, less {how}: depth 0 is where both arms are "
        f"equally long, a step is {1e3 * metadata.voxel_mm[0]:.4g} µm of optical path"
    )
    return FileVolume(volume, known, None, (note,))


def _profiled(spectra: Array, metadata: SpectraMetadata) -> Iterator[NDArray[np.float32]]:
    kernel = metadata.spectrometer.kernel()
    for bscan in spectra:
        counts = bscan.astype(np.float64)
        background = counts.mean(axis=0) if metadata.background is None else metadata.background
        yield profiles(counts - background, kernel)


def check_spectra_sidecar(data: Any, samples: int, path: Path) -> SpectraMetadata:
    """Check what a sidecar says of spectra.

    Raises
    ------
    ScanFileError
        When a key is missing, unknown or impossible.
    """
    if not isinstance(data, Mapping) or set(data) - set(SPECTRA_KEYS):
        raise ScanFileError(
            f"{path}: spectra is {data!r}; give it the keys {', '.join(SPECTRA_KEYS)}"
        )
    if not _LEAST_SAMPLES <= samples <= _MOST_SAMPLES:
        raise ScanFileError(
            f"{path}: spectra of {samples} samples (limits {_LEAST_SAMPLES} and {_MOST_SAMPLES}); "
            "mend shape: B-scans, A-scans, samples"
        )
    try:
        place, step = place_of_wavelengths(_wavelengths(data, samples, path))
    except ValueError as exc:
        raise ScanFileError(f"{path}: spectra: {exc}; mend wavelength_nm") from exc
    window = data.get("window", "hann")
    if window not in WINDOWS:
        raise ScanFileError(f"{path}: spectra: window is {window!r}; known are {WINDOWS}")
    dispersion = _numbers(data.get("dispersion", [0.0, 0.0]), 2, "dispersion", path)
    dy, dx = _numbers(data.get("spacing_mm"), 2, "spacing_mm (dy, dx)", path)
    spectrometer = Spectrometer(place, (dispersion[0], dispersion[1]), window)
    return SpectraMetadata(spectrometer, (step, dy, dx), _background(data, samples, path))


def _wavelengths(data: Mapping[str, Any], samples: int, path: Path) -> FloatArray:
    table, terms = data.get("wavelength_nm"), data.get("wavelength_polynomial_nm")
    if (table is None) is (terms is None):
        raise ScanFileError(
            f"{path}: spectra: give wavelength_nm (the first and the last, one for each sample, or "
            "a file of them) or wavelength_polynomial_nm (c0, c1 ... over the sample's number)"
        )
    if terms is not None:
        if not isinstance(terms, list) or not 2 <= len(terms) <= _MOST_TERMS:
            raise ScanFileError(f"{path}: wavelength_polynomial_nm needs 2 to {_MOST_TERMS} terms")
        factors = _numbers(terms, len(terms), "wavelength_polynomial_nm", path)
        number = np.arange(samples, dtype=np.float64)
        return np.asarray(np.polynomial.polynomial.polyval(number, factors), dtype=np.float64)
    if isinstance(table, str):
        return _listed(table, samples, path)
    if isinstance(table, list) and len(table) == 2:
        first, last = _numbers(table, 2, "wavelength_nm", path)
        return np.linspace(first, last, samples)
    return np.array(_numbers(table, samples, "wavelength_nm", path))


def _background(data: Mapping[str, Any], samples: int, path: Path) -> FloatArray | None:
    name = data.get("background", "auto")
    if name == "auto":
        return None
    if name == "none":
        return np.zeros(samples)
    return _listed(str(name), samples, path)


def _listed(name: str, samples: int, path: Path) -> FloatArray:
    """Numbers of a text file in the scan's own folder, one for each sample."""
    place = (path.parent / name).resolve()
    if place.parent != path.parent.resolve() or not place.is_file():
        raise ScanFileError(f"{path}: its file {name!r} isn't in its folder; put it there")
    try:
        values = [float(word) for word in place.read_text(encoding="utf-8").split()]
    except ValueError as exc:
        raise ScanFileError(f"{place}: holds something else than numbers ({exc})") from exc
    return np.array(_numbers(values, samples, name, path))


def _numbers(values: Any, count: int, name: str, path: Path) -> list[float]:
    if (
        not isinstance(values, list)
        or len(values) != count
        or not all(isinstance(v, int | float) and math.isfinite(v) for v in values)
    ):
        shown = f"{len(values)} values" if isinstance(values, list) else repr(values)
        raise ScanFileError(f"{path}: spectra: {name} has {shown}; it must be {count} numbers")
    return [float(value) for value in values]


_KINDS = ("uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64")


def read_raw(path: Path) -> FileVolume:
    """A view of a raw file.

    ``shape`` (slowest axis first, as ``axes`` names them) and ``dtype`` are needed; ``byte_order``
    (little, big) where a number has more than one byte; ``offset_bytes`` skips a header;
    ``spectra`` says that they are interference spectra, of which the volume is made.

    Raises
    ------
    ScanFileError
        When the sidecar doesn't say it all, or the file isn't exactly as long as it says.
    """
    metadata = sidecar(path, RAW_KEYS)
    missing = [name for name in ("shape", "dtype", "axes") if name not in metadata]
    if missing:
        raise ScanFileError(
            f"{path}: raw numbers of which {path.stem}.yaml beside it doesn't say "
            f"{', '.join(missing)}; add it (shape slowest first, like axes)"
        )
    shape, kind, offset = (
        _shape(metadata["shape"], path),
        _dtype(metadata, path),
        metadata.get("offset_bytes"),
    )
    start = offset if isinstance(offset, int) and offset >= 0 else 0
    size = path.stat().st_size - start
    if bytes_of(shape, kind, path) != size:
        raise ScanFileError(
            f"{path}: holds {size} bytes after {start} of header, but {' × '.join(map(str, shape))}"
            f" voxels of {kind} take {bytes_of(shape, kind, path)}; mend shape, dtype or "
            "offset_bytes in the sidecar"
        )
    numbers = mapped(path, kind, start, shape)
    if metadata.get("spectra") is None:
        return FileVolume(numbers)
    if metadata["axes"] != "yxz":
        raise ScanFileError(
            f"{path}: spectra with the axes {metadata['axes']!r}; lay them out yxz: B-scans, "
            "A-scans, samples"
        )
    return volume_of_spectra(
        numbers, check_spectra_sidecar(metadata["spectra"], shape[2], path), path
    )


def _shape(value: Any, path: Path) -> tuple[int, ...]:
    if (
        not isinstance(value, list)
        or len(value) != 3
        or not all(isinstance(size, int) and size > 0 for size in value)
    ):
        raise ScanFileError(f"{path}: shape is {value!r}; it must be three whole numbers above 0")
    return tuple(value)


def _dtype(metadata: dict[str, Any], path: Path) -> np.dtype[np.generic]:
    name, order = metadata["dtype"], metadata.get("byte_order")
    if name not in _KINDS:
        raise ScanFileError(f"{path}: dtype is {name!r}; known are {', '.join(_KINDS)}")
    kind = np.dtype(name)
    if kind.itemsize == 1:
        return kind
    if order not in ("little", "big"):
        raise ScanFileError(f"{path}: byte_order is {order!r}; give little or big in the sidecar")
    return kind.newbyteorder("<" if order == "little" else ">")
