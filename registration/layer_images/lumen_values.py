"""Data classes of lumens in a layer: expected, and as seen."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Lumen:
    """Area of the layer that must stay free of ink.

    Attributes
    ----------
    name : str
    outline : (k, 3) float64, mm
        Closed polygon.
    width_mm : float, mm
        Expected, across.
    """

    name: str
    outline: FloatArray
    width_mm: float

    @staticmethod
    def capsule(name: str, start: FloatArray, end: FloatArray, width_mm: float) -> Lumen:
        """Return the area nearer than half a width to a straight piece; a disc of start = end."""
        start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
        turn = math.atan2(*(end - start)[1::-1].tolist())
        half = np.linspace(-np.pi / 2, np.pi / 2, 17)
        angles = turn + np.concatenate([half, half + np.pi])
        middles = np.repeat([end, start], 17, axis=0)
        out = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))])
        return Lumen(name, middles + 0.5 * width_mm * out, width_mm)


@dataclass(frozen=True)
class LumenSeen:
    """What is seen of a lumen.

    Attributes
    ----------
    name : str
    expected_mm : float, mm
    width_mm, u_width_mm : float, mm
        Narrowest free width and its standard uncertainty; NaN where not seen.
    open_share : float
        Of its area without ink; NaN where not seen.
    seen : bool
    p_value : float
        Chance of so narrow a lumen, by noise, where it is as expected; 1 where not seen.
    """

    name: str
    expected_mm: float
    width_mm: float
    u_width_mm: float
    open_share: float
    seen: bool
    p_value: float
