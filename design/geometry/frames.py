"""Two unit vectors perpendicular to each given axis, as right-handed frames."""

from __future__ import annotations

import numpy as np

from kernels.arrays import FloatArray


def vectors_across(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors that make a right-handed frame with each unit vector of ``axis``.

    The first is e × axis, e the coordinate axis that lies least along it. The same for an axis and
    its opposite up to order and sign, so that collinear tubes share vertices.

    Parameters
    ----------
    axis : (3,) or (n, 3) float64

    Returns
    -------
    first, second : of the shape of ``axis``
    """
    first = np.cross(np.eye(3)[np.argmin(np.abs(axis), axis=-1)], axis)
    one = axis.ndim == 1
    first /= np.linalg.norm(first) if one else np.linalg.norm(first, axis=1)[:, None]
    return first, np.cross(axis, first)
