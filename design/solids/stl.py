"""Write a solid as binary STL; read such a file's triangles without a mesh library."""

from __future__ import annotations

from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.files import write_bytes
from design.geometry.surface import START_BYTES, TRIANGLE
from design.solids.solid import Solid
from kernels import jit

_HEADER = b"printctl; mm"
"""STL has no field for a unit; the header is the one place to say it."""


def write_stl(path: Path, solid: Solid) -> None:
    """Write ``solid`` as binary STL in mm.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    triangles = np.zeros(len(solid.faces), dtype=TRIANGLE)
    numbers = _numbers(np.ascontiguousarray(solid.vertices), np.ascontiguousarray(solid.faces))
    triangles["normal"] = numbers[:, 0]
    triangles["corners"] = numbers[:, 1:]
    count = np.array(len(triangles), dtype="<u4").tobytes()
    write_bytes(path, b"".join((_HEADER.ljust(80), count, triangles.tobytes())))


@jit
def _numbers(vertices: Any, faces: Any) -> Any:
    """Unit normal and corners of each face, (m, 4, 3); a face without area has no normal."""
    out = np.zeros((len(faces), 4, 3), np.float32)
    for f in range(len(faces)):
        a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = sqrt(x * x + y * y + z * z)
        if length > 0.0:
            out[f, 0, 0], out[f, 0, 1], out[f, 0, 2] = x / length, y / length, z / length
        for axis in range(3):
            out[f, 1, axis], out[f, 2, axis], out[f, 3, axis] = a[axis], b[axis], c[axis]
    return out


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
    if count == 0 or len(data) != START_BYTES + count * TRIANGLE.itemsize:
        return None
    triangles = np.frombuffer(data, TRIANGLE, count, START_BYTES)
    return np.asarray(triangles["corners"])
