"""Find pairs of a tissue surface's faces that intersect and share no vertex."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.geometry.crossings import find_crossings
from design.tissue.closed import FaceArray
from kernels.arrays import FloatArray

_FLAT = 1e-12
"""Height over longest edge below which a face counts as a line: far below what float32 tells."""


def crossing_faces(vertices: FloatArray, faces: FaceArray) -> NDArray[np.int64]:
    """Pairs of faces (k, 2) that meet and share no vertex.

    Neighbours aren't tried, nor faces without area: where slivers of a drawing program fold over
    their neighbours by the file's rounding, nothing has to be mended.
    """
    wide = np.flatnonzero(_has_area(vertices[faces]))
    pairs = wide[find_crossings(vertices, faces[wide]).pairs]
    one, two = faces[pairs[:, 0]], faces[pairs[:, 1]]
    return pairs[(one[:, :, None] != two[:, None, :]).all(axis=(1, 2))]


def _has_area(corners: FloatArray) -> NDArray[np.bool_]:
    edges = np.roll(corners, -1, axis=1) - corners
    longest = (edges**2).sum(axis=2).max(axis=1)
    twice = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    return np.asarray(twice > _FLAT * longest)
