"""Smooth a surface's noise without shrinking it."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array

from kernels.arrays import FloatArray

SMOOTHING_STEPS: Final = (0.5, -0.53)
"""Taubin 1995 ("A signal processing approach to fair surface design"): a step inwards and a longer
one out let waves pass that are longer than some ten edges (1/0.5 - 1/0.53 = 0.11)."""


def denoised(points: FloatArray, faces: NDArray[np.integer], passes: int) -> FloatArray:
    """Points (n, 3) moved by ``passes`` pairs of Taubin's steps, mm.

    Meant for even triangles such as marching cubes make; long ones are no noise.
    """
    if passes == 0:
        return points
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    ends = np.concatenate([ends, ends[:, ::-1]])
    count = len(points)
    joined = csr_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
    joined.data[:] = 1.0  # An edge is found from both of its triangles.
    mean = diags_array(1.0 / np.maximum(joined.sum(axis=1), 1.0)) @ joined
    for _ in range(passes):
        for step in SMOOTHING_STEPS:
            points = points + step * (mean @ points - points)
    return np.asarray(points)
