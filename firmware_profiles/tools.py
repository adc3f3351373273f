"""Needle and syringe profiles: diameters, lengths, volume, pressure limit, friction."""

from __future__ import annotations

import math
from typing import Annotated, Final

from pydantic import Field, model_validator

from firmware_profiles.strict_model import Facts, NonNegative, Positive

THINNEST_BORE: Final = 0.8
"""Narrowest line that is written without asking, as a part of the needle's bore: a starting value,
not measured. A tip that outruns the ink draws it thinner, until it breaks."""


class Needle(Facts):
    """A blunt needle, or a tapered tip."""

    inner_mm: Annotated[float, Field(gt=0, le=3)] = Field(description="Bore at the opening.")
    outer_mm: Annotated[float, Field(gt=0, le=5)] = Field(description="Of the shaft.")
    length_mm: Annotated[float, Field(gt=0, le=200)]
    hub_outer_mm: Annotated[float, Field(gt=0, le=60)] | None = Field(
        default=None,
        description="Widest of what is above the shaft and may dip below a rim: hub and syringe's "
        "end. Not measured without, and taken as 12.",
    )
    tip_outer_mm: Annotated[float, Field(gt=0, le=5)] | None = Field(
        default=None, description="Of a tapered tip: outside at the opening; with cone_mm."
    )
    cone_mm: Annotated[float, Field(gt=0, le=200)] | None = Field(
        default=None, description="Of a tapered tip: height over which it widens to outer_mm."
    )

    @model_validator(mode="after")
    def _has_a_wall(self) -> Needle:
        if (self.tip_outer_mm is None) != (self.cone_mm is None):
            raise ValueError("tip_outer_mm and cone_mm describe a tapered tip together: give both")
        if self.tip_outer_mm is not None and not self.tip_outer_mm <= self.outer_mm:
            raise ValueError(
                f"tip_outer_mm {self.tip_outer_mm:g} is above outer_mm {self.outer_mm:g}"
            )
        tip = self.tip_outer_mm or self.outer_mm
        if not self.inner_mm < tip:
            raise ValueError(f"inner {self.inner_mm:g} mm isn't below outer {tip:g} mm")
        return self


class Syringe(Facts):
    """A syringe."""

    inner_mm: Annotated[float, Field(gt=0, le=60)]
    volume_ul: Annotated[float, Field(gt=0, le=100_000)]
    dead_volume_ul: NonNegative = 0.0
    max_pressure_kpa: Positive | None = Field(
        default=None, description="What barrel and tip bear; unknown without."
    )
    friction_n: NonNegative | None = Field(
        default=None,
        description="What moves the plunger of the empty syringe; unknown without, and then not "
        "in the force.",
    )

    @model_validator(mode="after")
    def _holds_ink_to_print(self) -> Syringe:
        if not self.dead_volume_ul < self.volume_ul:
            raise ValueError(
                f"dead_volume_ul {self.dead_volume_ul:g} isn't below volume_ul "
                f"{self.volume_ul:g}: no ink would be left to print with"
            )
        return self

    @property
    def area_mm2(self) -> float:
        """Cross-section of the bore: what the plunger pushes, µL a mm."""
        return math.pi / 4 * self.inner_mm**2
