"""Options of infill inside a FRESH part's walls: pattern, density, angles."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from design.errors import ToolpathError

Infill = Literal["lines", "concentric", "gyroid"]

#: A gyroid denser than this would write over itself.
DENSEST_GYROID = 0.7


@dataclass(frozen=True)
class Filling:
    """What fills the inside of the walls.

    Attributes
    ----------
    pattern : "lines", "concentric" or "gyroid"
    density : float
        Part of the inside that is filled; 1 is solid.
    angles_deg : tuple of float, °
        Direction of the lines, layer after layer in turn.
    """

    pattern: Infill = "lines"
    density: float = 1.0
    angles_deg: tuple[float, ...] = (0.0, 90.0)

    def __post_init__(self) -> None:
        if not 0 <= self.density <= 1:
            raise ToolpathError(
                f"infill_density is {self.density:g} (FRESH options); it must lie within 0 to 1"
            )
        if self.pattern == "gyroid" and self.density > DENSEST_GYROID:
            raise ToolpathError(
                f"infill_density is {self.density:g} (FRESH options); a gyroid's lines "
                f"meet above {DENSEST_GYROID:g}: choose lines, or less"
            )
        if not self.angles_deg or not all(map(math.isfinite, self.angles_deg)):
            raise ToolpathError(
                f"infill_angles_deg is {self.angles_deg} (FRESH options); give at least "
                "one finite angle"
            )
