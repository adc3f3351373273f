"""Encode arrays and 3D surfaces as compressed base64 text inside an HTML page.

Little-endian integers, deflated (RFC 1950) and in base64; the browser undoes both by itself
(``DecompressionStream``).
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from report.simplify import simplify
from report.surface import ReportSurface

Surfaces = Sequence[ReportSurface] | Sequence[dict[str, object]]
"""As they are, or packed."""
MAX_FACES = 400_000
"""Triangles of all surfaces of a page together."""
LEVEL = 4
"""Of deflating: 6 takes more than twice the time for 5 % less."""
STEPS = 65_534
"""Quantisation steps of a uint16; the value after the last stands for no data."""
NO_DATA = 65_535


@dataclass(frozen=True)
class PackedColumn:
    """How a page keeps one column of numbers.

    Attributes
    ----------
    name : str
    kind : {"u1", "u2", "i2", "i4", "f4"}
        Of the numbers kept. They are laid out byte by byte (all lowest bytes first), which deflates
        to half.
    step, low : float
        A value is ``low + step * number``.
    summed : bool
        Whether differences from row to row are kept.
    none : int or None
        Number that stands for no value (NaN).
    """

    name: str
    kind: str
    step: float = 1.0
    low: float = 0.0
    summed: bool = False
    none: int | None = None


def pack_table(
    columns: Sequence[PackedColumn], values: Mapping[str, NDArray[Any]]
) -> dict[str, object]:
    """Columns of equal length as JSON values: their form, how many rows, and their numbers."""
    return {
        "rows": len(values[columns[0].name]),
        "columns": [asdict(one) for one in columns],
        "data": pack_columns(columns, values),
    }


def pack_columns(columns: Sequence[PackedColumn], values: Mapping[str, NDArray[Any]]) -> str:
    """Numbers of columns of equal length, one column after the other."""
    return deflated(b"".join(_column_bytes(one, values[one.name]) for one in columns))


def _column_bytes(column: PackedColumn, values: NDArray[Any]) -> bytes:
    kind = np.dtype(f"<{column.kind}")
    if kind.kind == "f":
        return _planes(values.astype(kind))
    limits = np.iinfo(kind)
    whole = np.rint((np.asarray(values, np.float64) - column.low) / column.step)
    most = limits.max if column.none is None else column.none - 1
    known = np.clip(whole, limits.min, most)
    if column.none is not None:
        known = np.where(np.isfinite(whole), known, column.none)
    numbers = known.astype(np.int64)
    # Sums wrap, here as in the page.
    return _planes((np.diff(numbers, prepend=0) if column.summed else numbers).astype(kind))


def _planes(values: NDArray[Any]) -> bytes:
    size = values.dtype.itemsize
    return np.ascontiguousarray(values.view(np.uint8).reshape(-1, size).T).tobytes()


def deflated(data: bytes) -> str:
    """Deflate and encode bytes."""
    return base64.b64encode(zlib.compress(data, LEVEL)).decode("ascii")


def level_column(name: str, values: NDArray[Any], summed: bool = False) -> PackedColumn:
    """Column of 65,535 even levels between the extremes of ``values`` (off by half a step)."""
    known = values[np.isfinite(values)] if np.isfinite(values).any() else np.zeros(1)
    step = float(np.ptp(known)) / STEPS or 1.0
    return PackedColumn(name, "u2", step, float(known.min()), summed, None if summed else NO_DATA)


def pack_points(points: NDArray[np.floating[Any]], **more: NDArray[Any]) -> dict[str, object]:
    """Points (n, 3) as columns x, y and z, with further columns of float32 values."""
    places = {axis: points[:, k].astype(np.float64) for k, axis in enumerate("xyz")}
    columns = [level_column(axis, values, summed=True) for axis, values in places.items()]
    columns += [PackedColumn(name, "f4") for name in more]
    return pack_table(columns, places | more)


def pack_surface(surface: ReportSurface, max_faces: int) -> dict[str, object]:
    """All that the page needs to draw one surface, as JSON values."""
    shown = simplify(surface, max_faces)
    scalar, corners = shown.scalar, shown.surface.faces.ravel()
    return {
        "name": surface.name,
        "unit": surface.unit,
        "limits": list(surface.colour_limits()),
        "extremes": list(surface.extremes()),
        "vertex_count": len(shown.surface.vertices),
        "face_count": len(shown.surface.faces),
        "full_face_count": len(surface.surface.faces),
        "cell_mm": shown.cell_mm,
        "points": pack_points(shown.surface.vertices),
        "corners": pack_table([PackedColumn("vertex", "i4", summed=True)], {"vertex": corners}),
        "scalar": None
        if scalar is None
        else pack_table([level_column("value", scalar)], {"value": scalar}),
    }


def pack_surfaces(
    surfaces: list[ReportSurface], max_faces: int = MAX_FACES
) -> list[dict[str, object]]:
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


def pack_unpacked(surfaces: Surfaces) -> list[dict[str, object]]:
    """Pack surfaces that aren't packed yet."""
    plain = [one for one in surfaces if isinstance(one, ReportSurface)]
    return pack_surfaces(plain) if plain else [one for one in surfaces if isinstance(one, dict)]
