"""Read a scan volume and its geometry from DICOM (extra ``scans``)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.errors import ScanFileError
from registration.files.readers.common import (
    ANY_RATIO,
    LPS,
    Array,
    FileSpace,
    FileVolume,
    check_available,
    empty,
    file_space,
    import_extra,
    scan_file_errors,
)

# DICOM PS3.3 C.7.6.2 (image plane: ImageOrientationPatient holds the direction of growing column
# index, then of growing row index; the patient's frame is LPS), C.7.6.16 (functional groups),
# C.8.8.3.2 (GridFrameOffsetVector), C.11.1 (modality LUT).
_MOST_TURN = 1e-3
_MOST_UNEVEN = 0.01
_GREY = ("MONOCHROME1", "MONOCHROME2")


@dataclass(frozen=True)
class Stack:
    """Frames in order along their normal: row, column and slice directions are right-handed.

    Attributes
    ----------
    order : (n,) int
        Of the frames.
    step_mm : float
        From one to the next.
    space : FileSpace
        Array axes are frame, row, column.
    """

    order: NDArray[np.intp]
    step_mm: float
    space: FileSpace


def stack_frames(places: FloatArray, across: FloatArray, path: Path) -> Stack:
    """Frames by the positions of their first voxels.

    Parameters
    ----------
    places : (n, 3) float64, mm
        ImagePositionPatient.
    across : (n, 6) float64
        ImageOrientationPatient.

    Raises
    ------
    ScanFileError
        When the frames aren't parallel, not evenly spaced, or lie askew.
    """
    _check_parallel(across, path)
    along_x, along_y = across[0, :3], across[0, 3:]
    normal = np.cross(along_x, along_y)
    heights = places @ normal
    order = np.argsort(heights, kind="stable")
    _check_even(heights[order], path)
    way = (places[order[-1]] - places[order[0]]) / (len(order) - 1)
    space = file_space(LPS, [way, along_y, along_x], places[order[0]], path)
    _check_straight(places[order], way, path)
    return Stack(order, float(np.linalg.norm(way)), space)


def _check_parallel(across: FloatArray, path: Path) -> None:
    turn = np.abs(across - across[0]).max(axis=1)
    if not turn.max() <= _MOST_TURN:
        at = int(np.argmax(np.where(np.isfinite(turn), turn, np.inf)))
        raise ScanFileError(
            f"{path}: slice {at + 1} of {len(across)} has the orientation {across[at].tolist()}, "
            f"the first {across[0].tolist()}; slices must be parallel: give one series alone"
        )


def _check_even(heights: FloatArray, path: Path) -> None:
    steps = np.diff(heights)
    usual = float(np.median(steps))
    at = int(np.argmax(np.abs(steps - usual)))
    if steps.min() <= 1e-9:
        low = int(np.argmin(steps))
        raise ScanFileError(
            f"{path}: slices {low + 1} and {low + 2} lie in the same place, so that they aren't "
            "evenly spaced; there are two series, echoes or times: export one"
        )
    if abs(steps[at] - usual) > _MOST_UNEVEN * usual + 1e-6:
        raise ScanFileError(
            f"{path}: its slices aren't evenly spaced: {steps[at]:.4g} mm between slices {at + 1} "
            f"and {at + 2}, {usual:.4g} mm elsewhere (limit 1 %); one is missing or there are two "
            "series: copy or export it again"
        )


def _check_straight(places: FloatArray, way: FloatArray, path: Path) -> None:
    off = np.linalg.norm(places - places[0] - np.outer(np.arange(len(places)), way), axis=1)
    at, limit = int(np.argmax(off)), _MOST_UNEVEN * float(np.linalg.norm(way)) + 1e-6
    if off[at] > limit:
        raise ScanFileError(
            f"{path}: slice {at + 1} lies {off[at]:.4g} mm off the straight line through the "
            f"others (limit {limit:.4g} mm); resample it to a straight grid"
        )


def check_grey(data: Any, path: Path) -> None:
    """Refuse what isn't one plane of grey values.

    Raises
    ------
    ScanFileError
        For colour, palettes, tables of grey values and parts of a concatenation.
    """
    kind = str(data.get("PhotometricInterpretation", _GREY[1]))
    if int(data.get("SamplesPerPixel", 1)) != 1 or kind not in _GREY:
        raise ScanFileError(f"{path}: colour pictures ({kind}) aren't a scan; export grey values")
    if data.get("ModalityLUTSequence"):
        raise ScanFileError(f"{path}: its counts go through a table; export it with a slope")
    if int(data.get("InConcatenationTotalNumber", 1)) > 1:
        raise ScanFileError(
            f"{path}: is part {data.get('InConcatenationNumber')} of "
            f"{data.InConcatenationTotalNumber}; join the parts, or export it as one file"
        )


def check_header_sizes(data: Any, count: int, path: Path) -> None:
    """Hold the sizes in the header against the file."""
    shape = (count, int(data.Rows), int(data.Columns))
    ratio = ANY_RATIO if data.file_meta.TransferSyntaxUID.is_compressed else 1
    kind = np.dtype(f"u{int(data.BitsAllocated) // 8}")
    check_available(shape, kind, path.stat().st_size * ratio, path)


def rescaled(frames: Any, lines: list[tuple[float, float]], shape: Any, path: Path) -> Array:
    """Frames in order, each by its own slope and intercept; as stored where all are (1, 0).

    Parameters
    ----------
    frames : iterable of (rows, columns) arrays
        In order.
    lines : list of (slope, intercept)
        Of each.
    shape : (n, rows, columns)
        Of the volume.
    """
    plain = all(line == (1.0, 0.0) for line in lines)
    out: Array | None = None
    for at, (values, (slope, offset)) in enumerate(zip(frames, lines, strict=True)):
        part = values if plain else values.astype(np.float32) * np.float32(slope)
        if out is None:
            out = empty(shape, part.dtype, path)
        out[at] = part if plain else part + np.float32(offset)
    if out is None:
        raise ScanFileError(f"{path}: holds no frame; export it again")
    return out


def line_of(source: Any) -> tuple[float, float]:
    """Slope and intercept that a data set or functional group carries; (1, 0) without."""
    return float(source.get("RescaleSlope", 1)), float(source.get("RescaleIntercept", 0))


MAGIC = b"DICM"
_MOST_SLICES = 20_000
_MODALITY = {"CT": "microct", "OCT": "oct", "OPT": "oct"}
_PLACED = ("ImagePositionPatient", "ImageOrientationPatient", "PixelSpacing")
_INVERTED = (
    "MONOCHROME1: viewers show its high values dark; values were taken as stored, high being bright"
)
_THICKNESS = "frames are taken to touch: their spacing is SliceThickness, {:g} mm"


def is_dicom(path: Path) -> bool:
    """Whether a file has DICOM's preamble."""
    with path.open("rb") as handle:
        return handle.read(132)[128:] == MAGIC


def read_dicom(path: Path) -> FileVolume:
    """A multi-frame file, its frames stacked in the order of their positions.

    Raises
    ------
    ScanFileError
        When it is broken, compressed in a way that isn't supported, not a grey volume, or its
        frames don't make a straight stack.
    """
    with scan_file_errors(path, "DICOM"):
        data = import_extra("pydicom", path).dcmread(path)
        count = int(data.get("NumberOfFrames", 1))
        if count < 2:
            raise ScanFileError(f"{path}: holds one slice; give the folder that holds them all")
        return _multiframe(data, count, path)


def read_dicom_folder(folder: Path) -> FileVolume:
    """A folder of slices of one series, stacked in the order of their positions.

    Raises
    ------
    ScanFileError
        When the slices aren't of one series, don't make a straight stack, or one is broken.
    """
    pydicom = import_extra("pydicom", folder)
    files = sorted(place for place in folder.iterdir() if place.is_file() and is_dicom(place))
    if not 2 <= len(files) <= _MOST_SLICES:
        raise ScanFileError(f"{folder}: {len(files)} DICOM slices aren't a volume")
    with scan_file_errors(folder, "DICOM"):
        slices = [pydicom.dcmread(file, stop_before_pixels=True) for file in files]
        _check_one_series(slices, files, folder)
        places = np.array([item.ImagePositionPatient for item in slices], dtype=np.float64)
        across = np.array([item.ImageOrientationPatient for item in slices], dtype=np.float64)
        stack = stack_frames(places, across, folder)
        first = slices[0]
        spacing = [float(v) for v in first.PixelSpacing]
        frames = (pydicom.dcmread(files[at]).pixel_array for at in stack.order)
        lines = [line_of(slices[at]) for at in stack.order]
        shape = (len(files), int(first.Rows), int(first.Columns))
        volume = rescaled(frames, lines, shape, folder)
        return _found(volume, first, [stack.step_mm, *spacing], stack)


def _check_one_series(slices: list[Any], files: list[Path], folder: Path) -> None:
    series = {str(item.get("SeriesInstanceUID")) for item in slices}
    sizes = {(int(item.Rows), int(item.Columns)) for item in slices}
    frames = sorted({str(item.get("FrameOfReferenceUID", "none")) for item in slices})
    if len(frames) > 1:
        raise ScanFileError(
            f"{folder}: its slices say {len(frames)} frames of reference ({frames[0]}, "
            f"{frames[1]}), so their places don't belong together; give a folder of one"
        )
    if len(series) > 1 or len(sizes) > 1:
        raise ScanFileError(
            f"{folder}: holds {len(series)} series of {len(sizes)} sizes; give a folder of one"
        )
    for item, file in zip(slices, files, strict=True):
        check_grey(item, file)
        if int(item.get("NumberOfFrames", 1)) > 1:
            raise ScanFileError(f"{file}: is a multi-frame file in a folder of slices; give it")
        missing = [name for name in _PLACED if item.get(name) is None]
        if missing:
            raise ScanFileError(
                f"{file}: doesn't say {', '.join(missing)}, so that its place in the stack isn't "
                "known (SliceLocation doesn't say which way); export it with positions"
            )
    pixels = np.array([item.PixelSpacing for item in slices], dtype=np.float64)
    at = int(np.argmax(np.abs(pixels - pixels[0]).max(axis=1)))
    if not np.allclose(pixels, pixels[0], rtol=1e-3):
        raise ScanFileError(
            f"{files[at]}: has pixels of {pixels[at].tolist()} mm, {files[0].name} of "
            f"{pixels[0].tolist()}; give a folder of one series"
        )


def _multiframe(data: Any, count: int, path: Path) -> FileVolume:
    check_grey(data, path)
    check_header_sizes(data, count, path)
    groups = list(data.get("PerFrameFunctionalGroupsSequence") or ())
    shared = list(data.get("SharedFunctionalGroupsSequence") or ())
    if groups and len(groups) != count:
        raise ScanFileError(
            f"{path}: says where {len(groups)} frames lie but holds {count}; export it again"
        )
    per_frame = [[group, *shared, data] for group in groups] or [[*shared, data]] * count
    stack = _stack(data, per_frame, path)
    order = range(count) if stack is None else stack.order
    lines = [_line(sources) for sources in per_frame]
    pixels = data.pixel_array
    frames, shape = (pixels[at] for at in order), pixels.shape
    sizes, notes = _sizes(per_frame, stack, path)
    in_order = list(order) == list(range(count)) and set(lines) == {(1.0, 0.0)}
    volume = pixels if in_order else rescaled(frames, [lines[at] for at in order], shape, path)
    return _found(volume, data, sizes, stack, notes)


def _stack(data: Any, per_frame: list[list[Any]], path: Path) -> Stack | None:
    """From each frame's place and orientation, or the offsets of a grid; None without."""
    across = [_first(s, "PlaneOrientationSequence", "ImageOrientationPatient") for s in per_frame]
    places = [_first(s, "PlanePositionSequence", "ImagePositionPatient") for s in per_frame]
    if any(value is None for value in (*across, *places)):
        if any(value is not None for value in across):
            missing = sum(value is None for value in (*across, *places))
            raise ScanFileError(
                f"{path}: says how its frames are oriented but not where they lie ({missing} of "
                f"{2 * len(places)} entries are missing), so that their order may be mirrored; "
                "export it with a position for each frame"
            )
        return None
    turns = np.array([[float(v) for v in value] for value in across])
    where = np.array([[float(v) for v in value] for value in places])
    offsets = data.get("GridFrameOffsetVector")
    if offsets is not None and len(offsets) == len(where):
        heights = np.array([float(v) for v in offsets]) - float(offsets[0])
        where = where[0] + np.outer(heights, np.cross(turns[0, :3], turns[0, 3:]))
    return stack_frames(where, turns, path)


def _line(sources: Sequence[Any]) -> tuple[float, float]:
    for source in sources:
        inner = source.get("PixelValueTransformationSequence")
        if inner:
            return line_of(inner[0])
    return line_of(sources[-1])


def _sizes(
    per_frame: list[list[Any]], stack: Stack | None, path: Path
) -> tuple[list[float] | None, tuple[str, ...]]:
    """Frame step, row and column spacing, mm, and what was taken for granted."""
    spacings = [_first(s, "PixelMeasuresSequence", "PixelSpacing") for s in per_frame]
    if any(value is None for value in spacings):
        return None, ()
    pixels = np.array([[float(v) for v in value] for value in spacings])
    if not np.allclose(pixels, pixels[0], rtol=1e-3):
        at = int(np.argmax(np.abs(pixels - pixels[0]).max(axis=1)))
        raise ScanFileError(
            f"{path}: frame {at + 1} has pixels of {pixels[at].tolist()} mm, the first of "
            f"{pixels[0].tolist()}; export a volume of one size"
        )
    if stack is not None:
        return [stack.step_mm, *map(float, pixels[0])], ()
    step = _first(per_frame[0], "PixelMeasuresSequence", "SpacingBetweenSlices")
    if step:
        return [float(step), *map(float, pixels[0])], ()
    thick = _first(per_frame[0], "PixelMeasuresSequence", "SliceThickness")
    if not thick:
        return None, ()
    return [float(thick), *map(float, pixels[0])], (_THICKNESS.format(float(thick)),)


def _first(sources: Sequence[Any], sequence: str, name: str) -> Any:
    """A value from the first functional group (or data set) that has it."""
    for source in sources:
        inner = source.get(sequence)
        value = inner[0].get(name) if inner else source.get(name)
        if value is not None:
            return value
    return None


def _found(
    volume: Array,
    data: Any,
    sizes: Sequence[float] | None,
    stack: Stack | None,
    notes: tuple[str, ...] = (),
) -> FileVolume:
    """The volume with what its modality means; `sizes` as frames, rows, columns, mm."""
    modality = _MODALITY.get(str(data.get("Modality", "")))
    known: dict[str, object] = {"axes": "yzx" if modality == "oct" else "zyx"}
    if data.get("PhotometricInterpretation") == "MONOCHROME1":
        notes = (*notes, _INVERTED)
    if sizes is not None and all(math.isfinite(size) for size in sizes):
        frame, row, column = sizes
        known["voxel_mm"] = [row, frame, column] if modality == "oct" else [frame, row, column]
    if modality:
        known["modality"] = modality
    if modality == "microct":
        known["scale"] = "linear"
    return FileVolume(volume, known, None if stack is None else stack.space, notes)
