"""Make rotations spread evenly over all orientations, to start the pose search from."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from kernels.arrays import FloatArray

_PHI, _PSI = np.sqrt(2.0), 1.533751168755204288118041


def spread_rotations(count: int) -> FloatArray:
    """Return `count` rotation matrices, (count, 3, 3), spread evenly over SO(3).

    Super-Fibonacci spirals (Alexa 2022, 10.1109/CVPR52688.2022.00811, eq. 6).
    """
    s = np.arange(count) + 0.5
    inner, outer = np.sqrt(s / count), np.sqrt(1.0 - s / count)
    alpha, beta = 2 * np.pi * s / _PHI, 2 * np.pi * s / _PSI
    quaternions = np.stack(
        [
            inner * np.sin(alpha),
            inner * np.cos(alpha),
            outer * np.sin(beta),
            outer * np.cos(beta),
        ],
        axis=1,
    )
    return np.asarray(Rotation.from_quat(quaternions).as_matrix())
