"""Make a needle-free background for each picture from other pictures of the same camera."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.devices.camera_frame.frame import CameraFrame

_MEDIAN_OF: Final = 3
"""Pictures from which a median shows no needle."""
_CLEAR: Final = 3.0
"""Diameters between two needles, beyond the reach, for one to be ground of the other."""


def grounds(
    pictures: Sequence[NDArray[Any]],
    frame: CameraFrame,
    places_mm: FloatArray,
    outer_mm: float,
    reach_mm: float,
) -> list[NDArray[Any] | None]:
    """Return each picture's ground out of the others, None where none will do.

    Parameters
    ----------
    pictures : sequence of (h, w) or (h, w, 3)
        Of one camera that doesn't move.
    frame : CameraFrame
    places_mm : (n, 3) float64, mm
        The printer's positions.
    outer_mm, reach_mm : float, mm
    """
    images: list[NDArray[Any] | None] = []
    for k, place in enumerate(places_mm):
        ray = np.array(frame.eye_mm) - place
        side = np.array([-ray[1], ray[0], 0.0]) / max(float(np.hypot(ray[0], ray[1])), 1e-9)
        aside = np.abs((places_mm - place) @ side)
        free = [
            n for n in range(len(pictures)) if aside[n] > reach_mm + _CLEAR * outer_mm and n != k
        ]
        if len(free) >= _MEDIAN_OF:
            stack = np.stack([pictures[n] for n in free])
            images.append(np.median(stack, axis=0).astype(stack.dtype))
        elif free:
            images.append(pictures[max(free, key=lambda n: aside[n])])
        else:
            images.append(None)
    return images
