"""The recipe's lattices: regular channels to hold a grown tree against."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from design.lattices import LatticeKind
from printctl.recipe.parts import NetworkSection

_Width = Annotated[float, Field(gt=0, le=100)]


class LatticeNetwork(NetworkSection):
    """Channels of a regular lattice clipped to the tissue, with one inlet and one outlet."""

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
