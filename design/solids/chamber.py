"""Data class of an open bioreactor chamber's dimensions: inside, wall, floor, lid ledge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Chamber:
    """A bioreactor's body: an open vessel with a floor, walls and a ledge for a lid.

    Attributes
    ----------
    shape : "block" or "cylinder"
    inner_mm : (3,) floats, mm
        Inner width, depth and height; of a cylinder the width is the diameter and the depth isn't
        used.
    wall_mm, floor_mm : float, mm
    ledge_mm : float, mm
        Width of a step at the top of the wall on which a lid lies; below the wall's. 0 for none.
    ledge_depth_mm : float, mm
        From the rim down to that step.
    """

    shape: Literal["block", "cylinder"]
    inner_mm: tuple[float, float, float]
    wall_mm: float = 2.0
    floor_mm: float = 2.0
    ledge_mm: float = 0.0
    ledge_depth_mm: float = 1.0
