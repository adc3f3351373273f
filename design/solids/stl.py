"""Write a solid as binary STL; read such a file's triangles without a mesh library."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from design.files import write_bytes
from design.solids.solid import Solid

_HEADER = b"printctl; mm"
"""STL has no field for a unit; the header is the one place to say it."""

_START_BYTES = 84
"""Header, and how many triangles follow."""

_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def write_stl(path: Path, solid: Solid) -> None:
    """Write ``solid`` as binary STL in mm.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    corners = solid.vertices[solid.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    triangles = np.zeros(len(corners), dtype=_TRIANGLE)
    triangles["normal"] = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    triangles["corners"] = corners
    count = np.array(len(corners), dtype="<u4").tobytes()
    write_bytes(path, _HEADER.ljust(80) + count + triangles.tobytes())


def cut_short(path: Path) -> str:
    """Say what is missing of a binary STL whose header counts more than it holds; else empty.

    Raises
    ------
    OSError
        When the file can't be opened.
    """
    with path.open("rb") as file:
        start = file.read(_START_BYTES)
    held = (path.stat().st_size - _START_BYTES) // _TRIANGLE.itemsize
    count = int.from_bytes(start[80:84], "little")
    if len(start) < _START_BYTES or start.lstrip().startswith(b"solid") or held >= count:
        return ""
    return f"the file is cut short: its header counts {count} triangles, and it holds {held}"


def read_corners(path: Path) -> NDArray[np.float64] | None:
    """Corners (n, 3, 3) of a binary STL's triangles; None where the file isn't exactly one.

    Raises
    ------
    OSError
        When the file can't be opened.
    """
    corners = read_float32(path)
    return None if corners is None else np.asarray(corners.astype(np.float64))


def read_float32(path: Path) -> NDArray[np.float32] | None:
    """As `read_corners`, in the file's own precision and not copied."""
    data = path.read_bytes()
    count = int.from_bytes(data[80:84], "little")
    if count == 0 or len(data) != _START_BYTES + count * _TRIANGLE.itemsize:
        return None
    triangles = np.frombuffer(data, _TRIANGLE, count, _START_BYTES)
    return np.asarray(triangles["corners"])
