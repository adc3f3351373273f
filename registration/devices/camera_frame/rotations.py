"""Rotation matrices of rotation vectors, and back."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from kernels.arrays import FloatArray


def turned(vector: Sequence[float] | FloatArray) -> FloatArray:
    """Rotation matrix (3, 3) of a rotation vector (3,), rad."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector, dtype=np.float64))[0])


def turn_vector(matrix: FloatArray) -> FloatArray:
    """Rotation vector (3,), rad, of a rotation matrix (3, 3)."""
    return np.asarray(cv2.Rodrigues(np.asarray(matrix, dtype=np.float64))[0]).ravel()
