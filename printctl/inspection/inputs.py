"""Check type, shape and range of the public functions' arguments."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Real
from typing import Any, Final

import numpy as np

from kernels.arrays import FloatArray
from printctl.inspection.values import Appearance, ExpectedLines, Image
from registration.errors import PictureError

NUMBERS: Final = "fiu"
"""NumPy dtype kinds, as are `BOOLS` and whole numbers."""
BOOLS: Final = "b"
_WHOLE: Final = "iu"
_WORDS: Final = {NUMBERS: "numbers", BOOLS: "bool", _WHOLE: "whole numbers"}
_MIN_DETERMINANT: Final = 1e-9
"""Least determinant of an invertible matrix."""
_MAX_PLACE_MM: Final = 1e4
"""Largest coordinate of a place."""
_THICKNESS_LIMITS_MM: Final = (1e-3, 100.0)
PIXEL_LIMITS_MM: Final = (1e-6, 100.0)
"""Limits of the sides of a height map's cells."""


def check_type(value: Any, kind: type, name: str) -> None:
    """Raise `PictureError` unless a value is of a type."""
    if not isinstance(value, kind):
        raise PictureError(f"{name} is {_described(value)}; expected {kind.__name__}")


def check_array(
    value: Any, name: str, kinds: str, shape: tuple[int | str, ...], remedy: str = ""
) -> None:
    """Raise `PictureError` unless a value is an array of a kind and shape; a letter: any size."""
    good = isinstance(value, np.ndarray) and value.dtype.kind in kinds
    sizes = np.shape(value) if good else ()
    good = good and len(sizes) == len(shape)
    if not good or any(
        have != want and (isinstance(want, int) or not have)
        for have, want in zip(sizes, shape, strict=True)
    ):
        expected = f"({', '.join(map(str, shape))}{',' * (len(shape) == 1)})"
        raise PictureError(
            f"{name} is {_described(value)}; expected an array of {_WORDS[kinds]}, shape {expected}"
            f"{remedy}"
        )


def check_finite(value: Any, name: str, shape: tuple[int | str, ...]) -> None:
    """Raise `PictureError` unless a value is an array of finite numbers of a shape."""
    check_array(value, name, NUMBERS, shape)
    if not np.isfinite(value).all():
        raise PictureError(f"{name} holds NaN or infinite values; every number must be finite")


def check_number(value: Any, name: str, limits: tuple[float, float], unit: str) -> None:
    """Raise `PictureError` unless a value is a number within limits."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise PictureError(f"{name} is {_described(value)}; expected a number, {unit}")
    if not limits[0] <= float(value) <= limits[1]:
        raise PictureError(
            f"{name} is {float(value):g} {unit}; it must lie from {limits[0]:g} to "
            f"{limits[1]:g} {unit}"
        )


def check_slab(to_scan: Any, middle_z_mm: Any, thickness_mm: Any) -> None:
    """Raise `PictureError` unless a matrix can be undone and a layer has a height."""
    check_finite(to_scan, "the matrix from the printer to the scan", (4, 4))
    if abs(np.linalg.det(np.asarray(to_scan, dtype=np.float64))) < _MIN_DETERMINANT:
        raise PictureError(
            "the matrix from the printer to the scan can't be inverted: a row or column is 0, or "
            "two are alike; check printer_to_scan"
        )
    check_number(middle_z_mm, "middle_z_mm", (-_MAX_PLACE_MM, _MAX_PLACE_MM), "mm")
    check_thickness(thickness_mm)


def check_thickness(thickness_mm: Any) -> None:
    """Raise `PictureError` unless a thickness is within the limits for a layer."""
    check_number(thickness_mm, "thickness_mm", _THICKNESS_LIMITS_MM, "mm")


def check_picture(picture: Any, name: str) -> None:
    """Raise `PictureError` unless a value is a grey or colour picture that isn't empty."""
    good = isinstance(picture, np.ndarray) and picture.ndim in (2, 3) and picture.size > 0
    kind = picture.dtype if isinstance(picture, np.ndarray) else np.dtype(bool)
    good = good and (kind in (np.uint8, np.uint16) or np.issubdtype(kind, np.floating))
    if not good or min(np.shape(picture)[:2]) < 16:
        raise PictureError(
            f"{name} is {_described(picture)}; expected (rows, columns) or "
            "(rows, columns, channels) of uint8, uint16 or float, 16 x 16 or more"
        )


def check_before(before: Any, picture: Image) -> None:
    """Raise `PictureError` unless the picture before matches the picture, from a camera."""
    check_picture(before, "the picture before")
    had, has = _described(before), _described(picture)
    if had != has:
        raise PictureError(
            f"the picture before is {had}, this one {has}; take both with the "
            "same camera and settings"
        )
    if picture.dtype.kind == "f" and picture.ndim == 3 and picture.shape[2] == 2:
        raise PictureError("a height map is judged without a picture before; leave `before` out")


def check_frame(frame: Any, places_mm: FloatArray) -> None:
    """Raise `PictureError` unless a frame maps places (n, 3) of lines to finite pixels."""
    to_pixels = getattr(frame, "to_pixels", None)
    if not callable(to_pixels):
        raise PictureError(
            f"frame is {_described(frame)}; expected an object with to_pixels(points_mm), as "
            "`height_map` or the file of `printctl observe frame` gives it"
        )
    at = to_pixels(places_mm)
    check_array(at, "what frame.to_pixels returns", NUMBERS, (len(places_mm), 2))
    lost = int((~np.isfinite(at)).any(axis=1).sum())
    if lost:
        raise PictureError(
            f"frame.to_pixels returns no finite pixel for {lost} of {len(at)} places of the lines "
            "(NaN: behind the camera); check the frame (printctl observe check)"
        )


def check_lines(lines: Any) -> None:
    """Raise `PictureError` unless lines are matching arrays with positive widths, some fresh."""
    if not isinstance(lines, ExpectedLines):
        raise PictureError(f"lines is {_described(lines)}; expected ExpectedLines")
    count = np.size(lines.width_mm)
    for name in ("start", "end"):
        check_finite(getattr(lines, name), f"expected lines: {name}", (count, 3))
    check_finite(lines.width_mm, "expected lines: width_mm", (count,))
    for name, kinds in (("line", NUMBERS), ("stroke", _WHOLE), ("fresh", BOOLS)):
        check_array(getattr(lines, name), f"expected lines: {name}", kinds, (count,))
    if not (lines.width_mm > 0).all():
        raise PictureError("expected lines: a width isn't above 0 mm; leave out lines without ink")
    if not lines.fresh.any():
        raise PictureError("expected lines: none is of the layer that is to be judged (fresh)")


def check_lumens(lumens: Any, name: str) -> None:
    """Raise `PictureError` unless all are lumens with a finite outline and a width."""
    _check_list(lumens, name, "Lumen")
    for lumen in lumens:
        outline = getattr(lumen, "outline", None)
        if outline is None:
            raise PictureError(f"{name} holds {_described(lumen)}; expected Lumen")
        check_finite(outline, f"lumen {lumen.name}: outline", ("k", 3))
        check_number(lumen.width_mm, f"lumen {lumen.name}: width_mm", (1e-6, _MAX_PLACE_MM), "mm")


def check_hidden(hidden: Any, shape: tuple[int, ...]) -> None:
    """Raise `PictureError` unless hidden areas are (h, w) bool, or polygons (k, 2)."""
    if isinstance(hidden, np.ndarray):
        check_array(hidden, "hidden", BOOLS, shape[:2], "; polygons go in a list")
        return
    _check_list(hidden, "hidden", "polygons (k, 2), px")
    for k, outline in enumerate(hidden):
        check_finite(outline, f"hidden: polygon {k}", ("k", 2))


def check_known(known: Any) -> None:
    """Raise `PictureError` unless an appearance is None or comes from an earlier look."""
    if known is not None:
        check_type(known, Appearance, "known")
        check_finite(known.profile, "known: profile", ("k", "m", "u", "c"))


def _check_list(value: Any, name: str, what: str) -> None:
    if not isinstance(value, Sequence):
        raise PictureError(f"{name} is {_described(value)}; expected a list of {what}")


def _described(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype}, shape {value.shape}"
    return f"a value of type {type(value).__name__}"
