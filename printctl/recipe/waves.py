"""Recipe section on 1D flow: waves along compliant vessels."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from firmware_profiles.strict_model import StrictModel


class OneDPart(StrictModel):
    """How the waves of `flow.pulse` are followed along vessels; all of it may be left out."""

    cell_mm: Annotated[float, Field(gt=1e-6, le=1e6)] | None = Field(
        default=None,
        description="Of 1D flow, mm; without it, what a wave runs in 1/800 of a period.",
    )
    wall_viscosity_pa_s: Annotated[float, Field(ge=0, le=1e9)] = Field(
        default=0.0, description="Of Kelvin-Voigt walls in 1D flow; 0 is elastic."
    )
    profile_exponent: Annotated[float, Field(ge=2, le=100)] = Field(
        default=2.0,
        description="Of 1D flow's velocity profile: 2 is a parabola, 9 blunt as in arteries.",
    )
    most_cycles: Annotated[int, Field(ge=1, le=100_000)] = Field(
        default=60, description="Until the flow must be periodic."
    )
