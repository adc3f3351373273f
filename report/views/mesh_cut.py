"""Intersect a triangle mesh with a plane normal to one of the axes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray


def cut_mesh(
    vertices: FloatArray, faces: NDArray[np.integer[Any]], axis: int, place: float
) -> FloatArray:
    """Cut a mesh by the plane x[`axis`] = `place`.

    Parameters
    ----------
    vertices : (n, 3) float64, mm
    faces : (m, 3) int
    axis : int
    place : float, mm

    Returns
    -------
    (k, 2, 2) float64, mm
        Start and end of each line in the two other coordinates, in their order.
    """
    off = vertices[:, axis] - place
    above = off[faces] >= 0
    cut = above.any(axis=1) & ~above.all(axis=1)
    corner, above = faces[cut], above[cut]
    if len(corner) == 0:
        return np.zeros((0, 2, 2))
    # The corner that lies alone on its side; the two edges from it are cut.
    alone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), above.argmin(axis=1))
    rows = np.arange(len(corner))
    apex = corner[rows, alone]
    ends = [corner[rows, (alone + k) % 3] for k in (1, 2)]
    others = [k for k in range(3) if k != axis]
    points = []
    for end in ends:
        share = off[apex] / (off[apex] - off[end])
        points.append(vertices[apex] + share[:, None] * (vertices[end] - vertices[apex]))
    return np.stack(points, axis=1)[:, :, others]


def lines_within(lines: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Lines (k, 2, 2) that touch a window between two corners (2,), mm."""
    near = (lines.max(axis=1) >= low) & (lines.min(axis=1) <= high)
    return lines[near.all(axis=1)]


def join_lines(lines: FloatArray) -> list[FloatArray]:
    """Chain lines (k, 2, 2) that share ends into polylines (j, 2), so that they draw small.

    Both triangles of a cut edge compute its point from the same corners, so that ends agree to
    rounding; they are compared on a grid of 1 nm.
    """
    keys = np.round(lines * 1e6).astype(np.int64)
    table: dict[tuple[int, int], list[int]] = {}
    for number, pair in enumerate(keys.tolist()):
        for end in pair:
            table.setdefault((end[0], end[1]), []).append(number)
    free = np.ones(len(lines), dtype=np.bool_)
    made = []
    for number in range(len(lines)):
        if free[number]:
            free[number] = False
            ahead = _follow(lines, keys, table, free, number, 1)
            behind = _follow(lines, keys, table, free, number, 0)
            made.append(np.array([*behind[::-1], *ahead]))
    return made


def _follow(
    lines: FloatArray,
    keys: NDArray[np.int64],
    table: dict[tuple[int, int], list[int]],
    free: NDArray[np.bool_],
    number: int,
    side: int,
) -> list[FloatArray]:
    """Points from one end of a line onwards, taking lines that are free."""
    made = [lines[number, side]]
    at = (int(keys[number, side, 0]), int(keys[number, side, 1]))
    while True:
        ahead = next((k for k in table[at] if free[k]), None)
        if ahead is None:
            return made
        free[ahead] = False
        far = 1 if (int(keys[ahead, 0, 0]), int(keys[ahead, 0, 1])) == at else 0
        made.append(lines[ahead, far])
        at = (int(keys[ahead, far, 0]), int(keys[ahead, far, 1]))
