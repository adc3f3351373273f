"""Named tuple of a tissue's signed distance samples and surface triangles, for kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

BRICK = 8
"""Fine cells along a brick's edge; a coarse cell is as large as a brick."""

BAND_CELLS = 2.0
"""Fine cells beyond the surface that bricks cover at least."""


class GridArrays(NamedTuple):
    """Samples of the signed distance, and the surface itself.

    Attributes
    ----------
    origin : (3,) float64, mm
        Sample (0, 0, 0).
    spacing : float, mm
        Of the fine samples.
    coarse : (a + 1, b + 1, c + 1) float32, mm
        Signed distance at the corners of the coarse cells.
    brick : (a, b, c) int32
        Which brick refines a coarse cell, -1 for none.
    samples : (n, 9, 9, 9) float32, mm
        Signed distance in each brick, its far faces included, so that a read stays in it.
    triangles ... size
        The exact surface, asked where the samples leave room for doubt: a `TriangleTree`, field
        by field, since numba's parallel loops take no tuple within a tuple. Kernels that take
        a tree take these arrays as well.
    """

    origin: NDArray[np.float64]
    spacing: float
    coarse: NDArray[np.float32]
    brick: NDArray[np.int32]
    samples: NDArray[np.float32]
    triangles: NDArray[np.float64]
    face: NDArray[np.int32]
    centre: NDArray[np.float64]
    reach: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    right: NDArray[np.int32]
    first: NDArray[np.int32]
    size: NDArray[np.int32]
