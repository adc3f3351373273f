"""Recipe sections on 3D flow, and on comparing 0D, 1D and 3D solutions of the flow."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from firmware_profiles.strict_model import StrictModel
from printctl.recipe.lattice_shape import LatticeShape


class ThreeDPart(StrictModel):
    """How flow is resolved in the lumens' space; all of it may be left out.

    Junctions are rounded as `solid.fillet_ratio` says: the lumen that is solved is the one that
    is printed.
    """

    edge_ratio: Annotated[float, Field(ge=0.1, le=1.0)] = Field(
        default=0.7, description="Of 3D: length of an element's edge over the lumen's radius."
    )
    order: Literal[2, 3] = Field(
        default=2, description="Of 3D elements, for velocity; 3 is more exact, and slower."
    )
    steps: Annotated[int, Field(ge=8, le=10_000)] = Field(
        default=24,
        description="Of a cycle in 3D, where the flow pulses and fidelities are compared.",
    )
    most_cycles: Annotated[int, Field(ge=1, le=100_000)] = Field(
        default=20, description="Of 3D: cycles after which it gives up."
    )
    inertia: bool = Field(default=True, description="Of 3D: Navier-Stokes; without it Stokes.")
    check: bool = Field(
        default=False,
        description="Solve 3D steadily once more, of the other order: an error estimate.",
    )
    memory_gb: Annotated[float, Field(gt=0, le=10_000)] | None = Field(
        default=None, description="3D is refused above it; without it, above what is free."
    )


class ComparePart(StrictModel):
    """Where fidelities are compared: amid every vessel, and at points along one."""

    along_vessel: Annotated[int, Field(ge=0)] | None = Field(
        default=None,
        description="Compare along this vessel, too; without it, the longest.",
    )
    points: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=10, description="Places along that vessel."
    )
    lattice: LatticeShape | None = Field(
        default=None,
        description="A lattice in the same tissue at the same flow, to hold the network against.",
    )
