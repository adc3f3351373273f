"""Write binary STL."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from design.files import write_bytes
from design.solids.solid import Solid

_HEADER = b"printctl; mm"
"""STL has no field for a unit; the header is the one place to say it."""

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
