"""Recipe section on supervising a print: checkpoints, dead-man's time, syringes, cell lifetime."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from firmware_profiles.materials import check_viability
from printctl.recipe.parts import Part


class CarePart(Part):
    """What `printctl print` has options for."""

    checkpoint_every_s: Annotated[float, Field(ge=0, le=86_400)] | None = Field(
        default=30.0,
        description="Least time between two checks of the position, which are made where a layer "
        "or pass ends; 0 for each end, null for none.",
    )
    deadman_min: Annotated[float, Field(ge=0, le=1440)] = Field(
        default=0.0,
        description="Pause unless somebody confirms within this time (printctl alive); 0 for an "
        "attended print.",
    )
    deadman_stops: bool = Field(default=False, description="Stop then, instead of pausing.")
    reload: bool = Field(
        default=False, description="Pause for a new syringe where one doesn't last."
    )
    reload_min: Annotated[float, Field(gt=0, le=600)] | None = Field(
        default=None, description="How long one change takes you; unknown without."
    )
    viability_min: Annotated[float, Field(gt=0, le=100_000)] | None = Field(
        default=None,
        description="How long the print may take for its cells' sake, changes of syringe "
        "included; the ink's own (viability_min) by default.",
    )
    viability_source: Annotated[str, Field(min_length=1)] | None = Field(
        default=None, description="Where viability_min comes from."
    )
    prime_ul: Annotated[float, Field(ge=0, le=1000)] = Field(
        default=0.0, description="Ink to push in addition after a pause."
    )

    silent_limit_s: Annotated[float, Field(ge=10, le=86_400)] | None = Field(
        default=None,
        description="End the print when the printer gives no usable answer for so long; 60 s by "
        "default, 1800 s for one line of a firmware that can't be asked (Klipper, RepRapFirmware).",
    )
    noise_limit: Annotated[int, Field(ge=1, le=500)] = Field(
        default=30,
        description="Pause when more lines than this among 500 had to be sent again.",
    )

    @model_validator(mode="after")
    def _a_budget_has_a_source(self) -> CarePart:
        check_viability(self.viability_min, self.viability_source)
        return self

    @model_validator(mode="after")
    def _stop_has_a_time(self) -> CarePart:
        if self.deadman_stops and not self.deadman_min:
            raise ValueError("deadman_stops needs a time; give deadman_min")
        return self
