"""DICOM: an enhanced multi-frame file, or a folder of slices, by pydicom (extra ``scans``).

Slices of computed tomography are depths. Frames of ophthalmic tomography (modality OPT) are
B-scans whose rows are depth, their positions often nominal: so written by OCT-Converter
(``write_opt_dicom``); its files, not a device's, are what this follows.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from registration.errors import ScanFileError
from registration.readers.broken import reading
from registration.readers.extras import need
from registration.readers.found import Array, Found
from registration.readers.limits import ANY_RATIO, check_available
from registration.readers.orient import is_right_handed
from registration.readers.storage import filled

MAGIC = b"DICM"
_MOST_SLICES = 20_000
_MODALITY = {"CT": "microct", "OCT": "oct", "OPT": "oct"}

Vector = NDArray[np.float64]


def is_dicom(path: Path) -> bool:
    """Whether a file has DICOM's preamble."""
    with path.open("rb") as handle:
        return handle.read(132)[128:] == MAGIC


def read_dicom(path: Path) -> Found:
    """A multi-frame file, its frames stacked in the order of their positions.

    Raises
    ------
    ScanFileError
        When it is broken, compressed in a way that isn't supported, or not a grey volume.
    """
    with reading(path, "DICOM"):
        data = need("pydicom", path).dcmread(path)
        count = int(data.get("NumberOfFrames", 1))
        if count < 2:
            raise ScanFileError(f"{path}: holds one slice; give the folder that holds them all")
        return _multiframe(data, count, path)


def read_dicom_folder(folder: Path) -> Found:
    """A folder of slices of one series, stacked in the order of their positions.

    Raises
    ------
    ScanFileError
        When the slices aren't of one series, not evenly spaced, or one is broken.
    """
    pydicom = need("pydicom", folder)
    files = sorted(place for place in folder.iterdir() if place.is_file() and is_dicom(place))
    if not 2 <= len(files) <= _MOST_SLICES:
        raise ScanFileError(f"{folder}: {len(files)} DICOM slices aren't a volume")
    with reading(folder, "DICOM"):
        slices = [pydicom.dcmread(file, stop_before_pixels=True) for file in files]
        series = {str(item.get("SeriesInstanceUID")) for item in slices}
        sizes = {(int(item.Rows), int(item.Columns)) for item in slices}
        if len(series) > 1 or len(sizes) > 1:
            raise ScanFileError(
                f"{folder}: holds {len(series)} series of {len(sizes)} sizes; give a folder of one"
            )
        first = slices[0]
        across = [float(v) for v in first.ImageOrientationPatient]
        places = np.array([item.ImagePositionPatient for item in slices], dtype=np.float64)
        order, step, right = _stacking(places, across, folder)
        spacing = [float(v) for v in first.PixelSpacing]
        rows, columns = sizes.pop()
        pages = (_grey(pydicom.dcmread(files[at]), folder) for at in order)
        start = _grey(pydicom.dcmread(files[0]), folder)
        volume = filled(pages, (len(files), rows, columns), start.dtype, folder)
        return _found(volume, first, [step, *spacing], right)


def _multiframe(data: Any, count: int, path: Path) -> Found:
    shape = (count, int(data.Rows), int(data.Columns))
    if int(data.get("SamplesPerPixel", 1)) != 1:
        raise ScanFileError(f"{path}: colour pictures aren't a scan; export grey values")
    kind = np.dtype(f"u{int(data.BitsAllocated) // 8}")
    if data.file_meta.TransferSyntaxUID.is_compressed:
        check_available(shape, kind, path.stat().st_size * ANY_RATIO, path)
    else:
        check_available(shape, kind, path.stat().st_size, path)
    frames = data.pixel_array
    groups = data.get("PerFrameFunctionalGroupsSequence")
    shared = data.get("SharedFunctionalGroupsSequence")
    sources = [groups[0] if groups else None, shared[0] if shared else None, data]
    spacing = _first(sources, "PixelMeasuresSequence", "PixelSpacing")
    across = _first(sources, "PlaneOrientationSequence", "ImageOrientationPatient")
    places = [_first([g], "PlanePositionSequence", "ImagePositionPatient") for g in groups or ()]
    right, step = None, _first(sources, "PixelMeasuresSequence", "SpacingBetweenSlices")
    step = step or _first(sources, "PixelMeasuresSequence", "SliceThickness")
    if len(places) == count and across is not None and all(p is not None for p in places):
        positions = np.array([[float(v) for v in p] for p in places])
        order, step, right = _stacking(positions, [float(v) for v in across], path)
        frames = frames[order]
    sizes = [step, *spacing] if step and spacing else None
    return _found(_rescaled(frames, data), data, sizes, right)


def _first(sources: list[Any], sequence: str, name: str) -> Any:
    """A value from the first functional group (or data set) that has it."""
    for source in sources:
        if source is None:
            continue
        inner = source.get(sequence)
        value = inner[0].get(name) if inner else source.get(name)
        if value is not None:
            return value
    return None


def _stacking(
    places: Vector, across: list[float], path: Path
) -> tuple[NDArray[np.intp], float, bool | None]:
    """Order, spacing and handedness of slices from where they lie.

    Slices are stacked along the way from the lowest to the highest along the normal of their
    plane (columns' direction × rows' direction): rows, columns and slices then are right-handed.
    """
    along_x, along_y = np.array(across[:3]), np.array(across[3:])
    normal = np.cross(along_x, along_y)
    heights = places @ normal
    order = np.argsort(heights, kind="stable")
    steps = np.diff(heights[order])
    if len(steps) == 0 or steps.min() <= 0 or np.ptp(steps) > 0.01 * steps.mean() + 1e-6:
        raise ScanFileError(
            f"{path}: its slices aren't evenly spaced ({steps.min():.4g} to {steps.max():.4g} mm); "
            "one is missing or there are two series"
        )
    step = float(steps.mean())
    return order, step, is_right_handed(np.array([along_x, along_y, normal]))


def _grey(data: Any, path: Path) -> Array:
    if int(data.get("SamplesPerPixel", 1)) != 1:
        raise ScanFileError(f"{path}: colour pictures aren't a scan; export grey values")
    return _rescaled(data.pixel_array, data)


def _rescaled(values: Array, data: Any) -> Array:
    """Stored values times slope plus intercept, where the data set has them."""
    slope, offset = float(data.get("RescaleSlope", 1)), float(data.get("RescaleIntercept", 0))
    if (slope, offset) == (1.0, 0.0):
        return values
    return values.astype(np.float32) * np.float32(slope) + np.float32(offset)


def _found(volume: Array, data: Any, sizes: list[Any] | None, right: bool | None) -> Found:
    """The volume with what its modality means; `sizes` as frames, rows, columns, mm."""
    modality = _MODALITY.get(str(data.get("Modality", "")))
    known: dict[str, Any] = {"axes": "yzx" if modality == "oct" else "zyx"}
    if sizes is not None and all(math.isfinite(float(size)) for size in sizes):
        frame, row, column = (float(size) for size in sizes)
        known["voxel_mm"] = [row, frame, column] if modality == "oct" else [frame, row, column]
    if modality:
        known["modality"] = modality
    if modality == "microct":
        known["scale"] = "linear"
    return Found(volume, known, None if modality == "oct" else right)
