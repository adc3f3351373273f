"""Geometry and grey values of DICOM frames: position, stacking order, rescaling.

DICOM PS3.3 C.7.6.2 (image plane: ImageOrientationPatient holds the direction of growing column
index, then of growing row index; the patient's frame is LPS), C.7.6.16 (functional groups),
C.8.8.3.2 (GridFrameOffsetVector), C.11.1 (modality LUT).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from registration.errors import ScanFileError
from registration.files.readers.limits import ANY_RATIO, check_available
from registration.files.readers.raw_result import Array
from registration.files.readers.space import LPS, FileSpace, file_space
from registration.files.readers.storage import empty

_MOST_TURN = 1e-3
_MOST_UNEVEN = 0.01
_GREY = ("MONOCHROME1", "MONOCHROME2")

Vector = NDArray[np.float64]


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


def stack_frames(places: Vector, across: Vector, path: Path) -> Stack:
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


def _check_parallel(across: Vector, path: Path) -> None:
    turn = np.abs(across - across[0]).max(axis=1)
    if not turn.max() <= _MOST_TURN:
        at = int(np.argmax(np.where(np.isfinite(turn), turn, np.inf)))
        raise ScanFileError(
            f"{path}: slice {at + 1} of {len(across)} has the orientation {across[at].tolist()}, "
            f"the first {across[0].tolist()}; slices must be parallel: give one series alone"
        )


def _check_even(heights: Vector, path: Path) -> None:
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


def _check_straight(places: Vector, way: Vector, path: Path) -> None:
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
