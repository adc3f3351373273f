"""Read a laser profiler's file: a height map (TIFF, PNG, NumPy, CSV) or points x, y, z as text.

Height maps are rows of heights at one spacing. Points are laid into cells of that spacing, each the
mean of its points. What wasn't measured becomes NaN: NaN itself, a value that the profiler writes
for it, 0 in whole numbers without a sign, and cells without a point.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import Float32Array, FloatArray
from registration.errors import ScanFileError
from registration.files.readers.common import scan_file_errors

TEXTS: Final = frozenset({".csv", ".txt", ".xyz", ".asc"})
_PICTURES: Final = frozenset({".tif", ".tiff", ".png"})
_LARGEST: Final = 100_000_000
"""Cells of points: more, and a point far off or a wrong spacing is the cause."""
_HEADER_LINES: Final = 100
_FLATTENED: Final = 1e6
"""Ratio of a matrix' longest axis to its shortest, from which on it can't be undone."""
_FAR_MM: Final = 1e4
"""No profiler measures so far: what lies beyond stands for "not measured"."""

_WITHIN: Final = re.compile(r"(?<=\d),(?=\d)")


@dataclass(frozen=True)
class HeightMap:
    """Heights of a surface at an even spacing, in the profiler's frame.

    Attributes
    ----------
    height_mm : (rows, columns) float32, mm
        Upwards; NaN where nothing was measured.
    pixel_mm : (x, y), mm
        From column to column and row to row.
    origin_mm : (x, y), mm
        Middle of the first one.
    to_map : (4, 4) float64 or None
        Takes the printer's places to the profiler's, mm, where the file says it.
    placed : bool
        Whether each height's place was measured, so that none can lie aside for one that was lost.
    """

    height_mm: Float32Array
    pixel_mm: tuple[float, float]
    origin_mm: tuple[float, float] = (0.0, 0.0)
    to_map: FloatArray | None = None
    placed: bool = False


def read_heights(
    path: Path,
    pixel_mm: tuple[float, float] | None = None,
    count_mm: float = 1.0,
    lost: float | None = None,
) -> HeightMap:
    """Read a profiler's file.

    Parameters
    ----------
    path : Path
    pixel_mm : (x, y) or None, mm
        Spacing of columns and rows, of points that of the cells; a `.npz` may hold its own.
    count_mm : float, mm
        What 1 of the file's heights is: 1 where they are in mm, 0.001 in µm.
    lost : float or None
        Value, as in the file, that says "not measured".

    Raises
    ------
    ScanFileError
        When the file isn't one, is cut off, or has no spacing.
    """
    ending = path.suffix.lower()
    with scan_file_errors(path, "height map"):
        if ending == ".npz":
            return _of_npz(path, pixel_mm, count_mm, lost)
        spacing = _spacing(path, pixel_mm)
        table = _table(path, ending)
    if table.ndim == 2 and table.shape[1] == 3 and ending not in _PICTURES:
        return _gridded(path, table, spacing, count_mm, lost)
    return HeightMap(_heights(path, table, count_mm, lost), spacing)


def _of_npz(
    path: Path, pixel_mm: tuple[float, float] | None, count_mm: float, lost: float | None
) -> HeightMap:
    with path.open("rb") as opened, np.load(opened) as file:
        heights = _heights(path, file["height_mm"], count_mm, lost)
        if "pixel_mm" in file:
            pixel_mm = _two_numbers(path, file["pixel_mm"])
        own = np.asarray(file["printer_to_scan"], float) if "printer_to_scan" in file else None
    if own is not None and (wrong := wrong_placement(own)):
        raise ScanFileError(f"{path}: printer_to_scan {wrong}; write it anew or leave it out")
    return HeightMap(heights, _spacing(path, pixel_mm), to_map=own, placed=own is not None)


def _two_numbers(path: Path, pixel_mm: NDArray[Any]) -> tuple[float, float]:
    if pixel_mm.shape != (2,):
        raise ScanFileError(
            f"{path}: pixel_mm is an array of shape {pixel_mm.shape}; write two numbers (x, y), mm"
        )
    return float(pixel_mm[0]), float(pixel_mm[1])


def wrong_placement(matrix: FloatArray) -> str:
    """Say what is wrong with a matrix that takes places to places; empty for nothing."""
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        return "isn't four rows of four numbers"
    if not np.array_equal(matrix[3], (0.0, 0.0, 0.0, 1.0)):
        return "must have 0, 0, 0, 1 as its last row"
    if np.linalg.cond(matrix[:3, :3]) > _FLATTENED:
        return "takes different places to the same one (an axis is 0, or two are alike)"
    return ""


def _spacing(path: Path, pixel_mm: tuple[float, float] | None) -> tuple[float, float]:
    if pixel_mm is None or not min(pixel_mm) > 0:
        raise ScanFileError(
            f"{path} doesn't say how far apart its heights lie; name it in observe.frame "
            "(pixel_mm: [x, y], mm)"
        )
    return pixel_mm


def _table(path: Path, ending: str) -> NDArray[Any]:
    """Numbers of a file, (rows, columns)."""
    if ending == ".npy":
        return np.asarray(np.load(path))
    if ending in TEXTS:
        return _of_text(path)
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if ending in _PICTURES else None
    if image is None:
        raise ScanFileError(
            f"{path} isn't a height map that can be read (TIFF or PNG of 16 or 32 bits, .npy, "
            ".npz with height_mm; .csv, .txt, .xyz or .asc with a table of heights or points)"
        )
    return np.asarray(image)


def _of_text(path: Path) -> NDArray[Any]:
    """Table of numbers behind a header, split by commas, semicolons, tabs or spaces."""
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    point = "." if ";" in text else " "  # what a comma stands for
    lines = text.replace(";", " ").splitlines()
    heads = [one.replace(",", point) for one in lines[:_HEADER_LINES]]
    begin = next((k for k, one in enumerate(heads) if _numbers(one)), None)
    if begin is None:
        raise ScanFileError(f"{path} holds no line of numbers")
    body = [one for one in lines[begin:] if one.strip()]
    point = "." if _is_decimal_comma(body[:_HEADER_LINES]) else point
    body = [one.replace(",", point) for one in body]
    wide = len(body[0].split())
    table = np.array(" ".join(body).split(), dtype=np.float64)
    if len(table) != wide * len(body):
        raise ScanFileError(
            f"{path}: its lines don't all have {wide} numbers; it is cut off, or lost points are "
            "left empty (let the profiler write a number or nan for them)"
        )
    return table.reshape(-1, wide)


def _is_decimal_comma(body: list[str]) -> bool:
    """Whether tabs or spaces split the numbers, and commas lie within them."""
    text = "\n".join(body)
    alone = all("," not in _WITHIN.sub("", one) for one in body)
    return "." not in text and alone and all(len(one.split()) > 1 for one in body)


def _numbers(line: str) -> bool:
    """Whether a line is of a table: two numbers at least."""
    words = line.split()
    try:
        return len([float(word) for word in words]) > 1
    except ValueError:
        return False


def _heights(path: Path, table: NDArray[Any], count_mm: float, lost: float | None) -> Float32Array:
    """Heights in mm, NaN where not measured."""
    good = table.dtype.kind in "fiu" and table.dtype != np.uint8
    if table.ndim != 2 or min(table.shape) < 16 or not good:
        raise ScanFileError(
            f"{path} is an array of {table.dtype}, shape {table.shape}; a height map has rows and "
            "columns (16 x 16 or more) of one number each, of 16 bits or more"
        )
    measured = np.isfinite(table) if table.dtype.kind == "f" else np.ones(table.shape, np.bool_)
    for value in [lost] if lost is not None else [0] if table.dtype.kind == "u" else []:
        measured &= table != value
    measured &= np.abs(table * count_mm) < _FAR_MM
    return np.where(measured, table * count_mm, np.nan).astype(np.float32)


def _gridded(
    path: Path,
    points: FloatArray,
    pixel_mm: tuple[float, float],
    count_mm: float,
    lost: float | None,
) -> HeightMap:
    """Mean height of the points (n, 3) in each cell; x and y are mm, z as ``count_mm`` says."""
    z = points[:, 2]
    good = np.isfinite(points).all(axis=1) & (np.abs(points) < _FAR_MM).all(axis=1)
    good &= np.abs(z * count_mm) < _FAR_MM
    good &= z != lost if lost is not None else True
    if not good.any():
        raise ScanFileError(f"{path} holds no point that was measured")
    low = points[good, :2].min(axis=0)
    cell = np.rint((points[good, :2] - low) / pixel_mm).astype(np.int64)
    columns, rows = (cell.max(axis=0) + 1).tolist()
    if min(columns, rows) < 16 or columns * rows > _LARGEST:
        raise ScanFileError(
            f"{path}: its points fill {columns} x {rows} cells of {pixel_mm[0]:g} x "
            f"{pixel_mm[1]:g} mm (16 x 16 to {_LARGEST:,}); correct pixel_mm in observe.frame"
        )
    at = cell[:, 1] * columns + cell[:, 0]
    count = np.bincount(at, minlength=rows * columns)
    total = np.bincount(at, z[good] * count_mm, minlength=rows * columns)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan).reshape(rows, columns)
    origin = (float(low[0]), float(low[1]))
    return HeightMap(mean.astype(np.float32), pixel_mm, origin, placed=True)
