"""Compute an OCT volume from raw spectra, by wavelengths and background given in a sidecar file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from registration.errors import ScanFileError
from registration.files.readers.fourier import (
    WINDOWS,
    Floats,
    Spectrometer,
    place_of_wavelengths,
    profiles,
)
from registration.files.readers.raw_result import Array, FileVolume
from registration.files.readers.storage import fill_volume

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
    background: Floats | None


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


def _wavelengths(data: Mapping[str, Any], samples: int, path: Path) -> Floats:
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


def _background(data: Mapping[str, Any], samples: int, path: Path) -> Floats | None:
    name = data.get("background", "auto")
    if name == "auto":
        return None
    if name == "none":
        return np.zeros(samples)
    return _listed(str(name), samples, path)


def _listed(name: str, samples: int, path: Path) -> Floats:
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
