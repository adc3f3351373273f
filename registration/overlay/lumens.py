"""Mask of the pixels inside the designed lumens at a given height of the part."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.solids.solid import Solid
from design.toolpath.fresh.section import manifold_of, rings
from registration.overlay.raster import Raster


class LumenSections:
    """Level sections of a design's lumens.

    Parameters
    ----------
    lumens : Solid
        Part frame, mm.

    Raises
    ------
    ToolpathError
        When they aren't a closed manifold.
    """

    def __init__(self, lumens: Solid) -> None:
        self._body = manifold_of(lumens, "the model of the lumens")

    def mask(self, raster: Raster, height_mm: float) -> NDArray[np.bool_]:
        """Pixels inside a lumen at a height of the part, (ny, nx)."""
        return raster.inside(rings(self._body.slice(height_mm)))
