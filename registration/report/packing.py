"""Encode arrays and 3D surfaces as compressed base64 text inside an HTML page.

Little-endian integers, deflated (RFC 1950) and in base64; the browser undoes both by itself
(``DecompressionStream``).
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from registration.report.simplify import simplify
from registration.report.surface import ReportSurface

Surfaces = Sequence[ReportSurface] | Sequence[dict[str, Any]]
"""As they are, or packed."""
MAX_FACES = 400_000
"""Triangles of all surfaces of a page together."""
LEVEL = 4
"""Of deflating: 6 takes more than twice the time for 5 % less."""
STEPS = 65_534
"""Quantisation steps of a uint16; the value after the last stands for no data."""
NO_DATA = 65_535


def pack(values: NDArray[Any]) -> str:
    """Deflate and encode an array whose dtype is already the wanted one."""
    little = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<"))
    return deflated(little.tobytes(), LEVEL)


@dataclass(frozen=True)
class PackedColumn:
    """How a page keeps one column of numbers.

    Attributes
    ----------
    name : str
    kind : {"u1", "u2", "i2", "i4", "f4"}
        Of the numbers kept. They are laid out byte by byte (all lowest bytes first), which deflates
        to half.
    step : float
        A value is this times its number.
    summed : bool
        Whether differences from row to row are kept.
    none : int or None
        Number that stands for no value (NaN).
    """

    name: str
    kind: str
    step: float = 1.0
    summed: bool = False
    none: int | None = None


def pack_columns(columns: Sequence[PackedColumn], values: Mapping[str, NDArray[Any]]) -> str:
    """Deflate and encode columns of equal length, one after the other."""
    return deflated(b"".join(_column_bytes(one, values[one.name]) for one in columns))


def _column_bytes(column: PackedColumn, values: NDArray[Any]) -> bytes:
    kind = np.dtype(f"<{column.kind}")
    if kind.kind == "f":
        return _planes(values.astype(kind))
    limits = np.iinfo(kind)
    whole = np.rint(np.asarray(values, np.float64) / column.step)
    if column.none is not None:
        known = np.clip(whole, limits.min, column.none - 1)
        whole = np.where(np.isnan(whole), column.none, known)
    whole = whole.astype(np.int64)
    if column.summed:
        whole = np.diff(whole, prepend=0)
    return _planes(np.clip(whole, limits.min, limits.max).astype(kind))


def _planes(values: NDArray[Any]) -> bytes:
    size = values.dtype.itemsize
    return np.ascontiguousarray(values.view(np.uint8).reshape(-1, size).T).tobytes()


def deflated(data: bytes, level: int = 6) -> str:
    """Deflate and encode bytes."""
    return base64.b64encode(zlib.compress(data, level)).decode("ascii")


def quantise(values: NDArray[np.float64]) -> tuple[NDArray[np.uint16], list[float], list[float]]:
    """Put each column of ``values`` (n, k) on 65,535 even levels between its extremes.

    Returns
    -------
    levels : (n, k) uint16
        `NO_DATA` where a value isn't finite.
    low, step : list of k floats
        ``value = low + step * level``, off by at most half a step.
    """
    finite = np.where(np.isfinite(values), values, np.nan)
    levels = np.full(values.shape, NO_DATA, dtype=np.uint16)
    low, step = [], []
    for k in range(values.shape[1]):
        ok = ~np.isnan(finite[:, k])
        column = finite[ok, k] if ok.any() else np.zeros(1)
        low.append(float(column.min()))
        step.append(float(np.ptp(column)) / STEPS or 1.0)
        levels[ok, k] = np.rint((finite[ok, k] - low[k]) / step[k]).astype(np.uint16)
    return levels, low, step


def pack_positions(points: NDArray[np.floating[Any]]) -> dict[str, Any]:
    """Points (n, 3) as differences from point to point of levels, wrapped to 16 bits."""
    levels, low, step = quantise(np.asarray(points, dtype=np.float64))
    steps = np.diff(levels, axis=0, prepend=np.zeros((1, 3), np.uint16))
    return {"positions": pack(steps), "low": low, "step": step}


def pack_faces(faces: NDArray[np.int64]) -> str:
    """Vertex numbers as differences to the number before, which deflate well."""
    flat = faces.ravel().astype(np.int32)
    return pack(np.diff(flat, prepend=np.int32(0)).astype(np.int32))


def pack_surface(surface: ReportSurface, max_faces: int) -> dict[str, Any]:
    """All that the page needs to draw one surface, as JSON values."""
    shown = simplify(surface, max_faces)
    result: dict[str, Any] = {
        "name": surface.name,
        "unit": surface.unit,
        "limits": list(surface.colour_limits()),
        "vertex_count": len(shown.surface.vertices),
        "face_count": len(shown.surface.faces),
        "full_face_count": len(surface.surface.faces),
        "cell_mm": shown.cell_mm,
        **pack_positions(shown.surface.vertices),
        "faces": pack_faces(shown.surface.faces),
        "scalar": None,
    }
    if shown.scalar is not None:
        value, value_low, value_step = quantise(shown.scalar[:, None])
        result["scalar"] = {
            "levels": pack(value[:, 0]),
            "low": value_low[0],
            "step": value_step[0],
        }
    return result


def pack_surfaces(
    surfaces: list[ReportSurface], max_faces: int = MAX_FACES
) -> list[dict[str, Any]]:
    """Pack every surface; together they keep to ``max_faces`` triangles.

    Small surfaces stay whole; what they leave is shared by the large ones.
    """
    allowed: dict[int, int] = {}
    left = max_faces
    order = sorted(range(len(surfaces)), key=lambda i: len(surfaces[i].surface.faces))
    for rank, index in enumerate(order):
        share = max(left // (len(order) - rank), 1)
        allowed[index] = min(share, len(surfaces[index].surface.faces))
        left -= allowed[index]
    return [pack_surface(surface, allowed[i]) for i, surface in enumerate(surfaces)]


def pack_unpacked(surfaces: Surfaces) -> list[dict[str, Any]]:
    """Pack surfaces that aren't packed yet."""
    plain = [one for one in surfaces if isinstance(one, ReportSurface)]
    return pack_surfaces(plain) if plain else [one for one in surfaces if isinstance(one, dict)]
