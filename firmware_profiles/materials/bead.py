"""Width of a printed line from its cross-section area and layer height, and back, by shape model.

Three models need no measurement; a measured one is a number of micrometres:

- ``rounded``: flat with round sides, A = (w - h) h + π h²/4, as slicers for plastic plan lines
  (Slic3r manual, "Flow math"); a circle, A = π w²/4, where w is below h.
- ``rectangle``: A = w h.
- ``ellipse``: A = π/4 w h.
- a number e: w = A/h + e/1000 mm; in lines narrower than high less, in the ratio of A/h to h.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from firmware_profiles.strict_model import BeadShape
from kernels.arrays import FloatArray

_SIDE: Final = 1 - math.pi / 4
"""What a round side leaves empty of the square of half the height, over both sides."""
_QUARTER: Final = math.pi / 4


@dataclass(frozen=True)
class BeadSection:
    """Model of a line's cross-section.

    Attributes
    ----------
    model : "rounded", "rectangle", "ellipse" or float, µm
        A number is the measured width over area / height.
    """

    model: BeadShape | float = "rounded"

    def width(self, area_mm2: FloatArray, height_mm: FloatArray | float) -> FloatArray:
        """Width of lines of a cross-section, mm.

        Parameters
        ----------
        area_mm2 : (n,) float64, mm²
            Below 0 counts as 0.
        height_mm : (n,) float64 or float, mm
        """
        height = np.asarray(height_mm, dtype=np.float64)
        area = np.maximum(area_mm2, 0.0)
        flat = area / height
        if self.model == "rectangle":
            return np.asarray(flat)
        if self.model == "ellipse":
            return np.asarray(flat / _QUARTER)
        if self.model == "rounded":
            small = 2.0 * np.sqrt(area / math.pi)
            return np.where(flat >= _QUARTER * height, flat + _SIDE * height, small)
        return np.asarray(flat + 1e-3 * self.model * np.minimum(flat / height, 1.0))

    def area(self, width_mm: FloatArray | float, height_mm: FloatArray | float) -> FloatArray:
        """Cross-section of lines of a width, mm²: the inverse of `width`."""
        height = np.asarray(height_mm, dtype=np.float64)
        width = np.maximum(width_mm, 0.0)
        if self.model == "rectangle":
            return np.asarray(width * height)
        if self.model == "ellipse":
            return np.asarray(_QUARTER * width * height)
        if self.model == "rounded":
            return np.where(width >= height, (width - _SIDE * height) * height, _QUARTER * width**2)
        excess = 1e-3 * self.model
        narrow = width / (1 + excess / height)
        return np.asarray(np.where(narrow < height, narrow, width - excess) * height)

    def spacing(self, width_mm: float, height_mm: float) -> float:
        """Distance at which lines of a width fill a layer, mm: area over height."""
        return float(self.area(width_mm, height_mm)) / height_mm

    @property
    def words(self) -> str:
        """The model in words, for notes."""
        if isinstance(self.model, str):
            sides = {"rounded": "round", "rectangle": "straight", "ellipse": "elliptic"}
            return f"{sides[self.model]} sides"
        return f"sides measured {self.model:g} µm wider than area over height"
