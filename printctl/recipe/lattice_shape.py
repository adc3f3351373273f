"""Recipe section of a lattice's shape: unit cell, channel size and ports."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from design.lattices import LatticeKind, LatticeOptions
from firmware_profiles.strict_model import StrictModel

_Width = Annotated[float, Field(gt=0, le=100)]


class LatticeShape(StrictModel):
    """A regular lattice clipped to the tissue."""

    lattice: LatticeKind
    cell_mm: _Width = Field(description="Edge of the unit cell.")
    diameter_mm: _Width = Field(description="Of the channels.")
    manifold_diameter_mm: _Width | None = Field(
        default=None,
        description="Of the ports and the layers beside them; 1.5 times diameter_mm by default.",
    )
    axis: Literal["x", "y", "z"] = Field(
        default="z", description="The inlet is at its lower end, the outlet at its upper."
    )
    clearance_mm: Annotated[float, Field(ge=0, le=10)] = 0.1

    def options(self) -> LatticeOptions:
        """In the design's words, which speak of radii."""
        wide = self.manifold_diameter_mm
        return LatticeOptions(
            kind=self.lattice,
            cell_mm=self.cell_mm,
            radius_mm=self.diameter_mm / 2,
            manifold_radius_mm=None if wide is None else wide / 2,
            axis=self.axis,
            clearance_mm=self.clearance_mm,
        )
