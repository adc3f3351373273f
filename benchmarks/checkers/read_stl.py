"""Independent reader of binary STL."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_FACET = np.dtype([("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("spare", "<u2")])


def read_stl(path: Path) -> NDArray[np.float64]:
    """Corners of the triangles, (f, 3, 3), mm, wound so that the enclosed volume is positive.

    Raises
    ------
    ValueError
        When the file isn't a binary STL.
    """
    data = path.read_bytes()
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else 0
    if count == 0 or len(data) != 84 + count * _FACET.itemsize:
        raise ValueError(f"{path} isn't a binary STL with at least one facet")
    corners = np.frombuffer(data, _FACET, offset=84)["corner"].astype(np.float64)
    return corners if enclosed_volume(corners) > 0 else corners[:, ::-1].copy()


def enclosed_volume(triangles: NDArray[np.float64]) -> float:
    """Volume inside closed triangles (f, 3, 3), mm³ (divergence theorem)."""
    one, two, three = (triangles[:, k] - triangles[0, 0] for k in range(3))
    return float(np.einsum("ij,ij->i", one, np.cross(two, three)).sum() / 6.0)


def write_stl(path: Path, triangles: NDArray[np.float64]) -> None:
    """Write triangles (f, 3, 3), mm, as a binary STL; for the shapes that benchmarks make."""
    facets = np.zeros(len(triangles), _FACET)
    facets["corner"] = triangles
    path.write_bytes(bytes(80) + len(triangles).to_bytes(4, "little") + facets.tobytes())


def box_triangles(low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """The twelve triangles of a box with corners ``low`` and ``high`` (3,)."""
    quads = []
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        for side, level in ((0, low), (1, high)):
            corner = np.array(4 * [level], dtype=np.float64)
            corner[[1, 2], one], corner[[0, 3], one] = high[one], low[one]
            corner[[2, 3], two], corner[[0, 1], two] = high[two], low[two]
            quads.append(corner if side else corner[::-1])
    return np.array([quad[k] for quad in quads for k in ([0, 1, 2], [0, 2, 3])])
