"""Split marked edges of a triangle mesh at their midpoints, without leaving gaps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.tissue.closed import Edges
from kernels.arrays import IntArray


def part_faces(faces: IntArray, edges: Edges, parted: NDArray[np.bool_], first: int) -> IntArray:
    """Faces with the ``parted`` (e,) edges halved.

    Parameters
    ----------
    faces : (m, 3) int64
    edges : Edges
        Of ``faces``.
    parted : (e,) bool
    first : int
        Number of the first new vertex; they come in the order of the parted edges.
    """
    number = np.full(len(edges.ends), -1)
    number[parted] = first + np.arange(int(parted.sum()))
    middle = number[edges.of_face.reshape(-1, 3)]
    halved = middle >= 0
    count = halved.sum(axis=1)
    parts = [faces[count == 0]]
    # Turned so that the edge that is alone, parted or not, leaves the first corner.
    for alone in (1, 2):
        rows = np.flatnonzero(count == alone)
        lone = np.argmax(halved[rows] == (alone == 1), axis=1)
        turn = (lone[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(faces[rows], turn, axis=1).T
        ab, bc, ca = np.take_along_axis(middle[rows], turn, axis=1).T
        if alone == 1:
            parts += [np.stack([a, ab, c], 1), np.stack([ab, b, c], 1)]
        else:
            parts += [np.stack([a, b, bc], 1), np.stack([a, bc, ca], 1), np.stack([ca, bc, c], 1)]
    rows = np.flatnonzero(count == 3)
    a, b, c = faces[rows].T
    ab, bc, ca = middle[rows].T
    corners = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    parts += [np.stack(corner, 1) for corner in corners]
    return np.concatenate(parts)
