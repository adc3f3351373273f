"""Shrinkage and lumen wall offset of an earlier FRESH print; enlarge a solid against shrinkage.

Registration measures both on a print: how much each axis shrank, and by how much every lumen's
wall stands inside the designed one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.errors import ToolpathError
from design.solids.solid import Solid

#: More than this isn't shrinkage but a wrong number, %.
MOST_PERCENT = 30.0


@dataclass(frozen=True)
class Compensation:
    """Shrinkage and wall offset measured on an earlier print.

    Attributes
    ----------
    shrink_percent : (x, y, z) float
        How much shorter each axis came out than it was written.
    radial_mm : float, mm
        By how much a lumen's radius came out too small; below 0 for too large.
    """

    shrink_percent: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radial_mm: float = 0.0

    def __post_init__(self) -> None:
        worst = max(self.shrink_percent, key=abs)
        if not abs(worst) <= MOST_PERCENT:
            raise ToolpathError(
                f"shrink_percent is {worst:g} (compensation); beyond {MOST_PERCENT:g} % either way "
                "something else is wrong: measure again"
            )
        if not abs(self.radial_mm) <= 1.0:
            raise ToolpathError(
                f"radial_mm is {self.radial_mm:g} (compensation); it must lie within -1 to 1 mm"
            )

    def enlarged(self, solid: Solid) -> Solid:
        """The solid as it must be written, larger about its origin."""
        if not any(self.shrink_percent):
            return solid
        scale = 1.0 / (1.0 - np.array(self.shrink_percent) / 100.0)
        vertices = (solid.vertices * scale).astype(np.float32).astype(np.float64)
        return Solid(vertices, solid.faces)
