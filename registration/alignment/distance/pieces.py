"""Build a part's bounding-box tree of triangles, long ones cut into pieces for smaller boxes.

Triangles that are long against the whole (flat faces, straight tubes) make boxes that overlap. They
are cut into pieces with boxes of their own (Ernst & Greiner 2007, 10.1109/RT.2007.4342593); what is
asked at a piece is still its whole triangle. Points near a block with lumens take two thirds of the
time.
"""

from __future__ import annotations

import numpy as np

from design.geometry import boxes_of, build_hierarchy
from kernels.arrays import FloatArray, IntArray

LONGEST = 0.15
"""Of the diagonal: longer edges are cut. Finer pieces only make more boxes."""


def hierarchy(triangles: FloatArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Build the tree of (m, 3, 3) triangles.

    Returns
    -------
    boxes, nodes : arrays
        See `design.geometry.bvh.build_hierarchy`.
    order : (k,) int64
        Triangles in the order of the leaves; those that were cut several times.
    """
    pieces, owner = _pieces(triangles)
    boxes, nodes, order = build_hierarchy(boxes_of(pieces))
    return boxes, nodes, owner[order]


def _pieces(triangles: FloatArray) -> tuple[FloatArray, IntArray]:
    """Cut triangles in the middle of their longest edge while it is long: (k, 3, 3), and whose."""
    corners = triangles.reshape(-1, 3)
    longest = LONGEST * float(np.linalg.norm(np.ptp(corners, axis=0)))
    whole, owner = triangles, np.arange(len(triangles))
    while True:
        edges = np.linalg.norm(np.roll(whole, -1, axis=1) - whole, axis=2)
        cut = np.flatnonzero(edges.max(axis=1) > longest)
        if not len(cut):
            return np.ascontiguousarray(whole), owner
        first = edges[cut].argmax(axis=1)
        a, b, c = (whole[cut, (first + k) % 3] for k in range(3))
        middle = (a + b) / 2
        halves = [np.stack(half, axis=1) for half in ((a, middle, c), (middle, b, c))]
        whole = np.concatenate([np.delete(whole, cut, axis=0), *halves])
        owner = np.concatenate([np.delete(owner, cut), owner[cut], owner[cut]])
