"""The sections of a recipe, each typed and bounded; an unknown key is refused.

Every number carries its unit in its key. Lengths of tissue are mm, of writing µm where the lab
says µm; flows mL/min and pressures mmHg as the lab says them. They are converted once, in the
pipeline.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, model_validator

from printctl.recipe.pulse import PulsePart
from printctl.recipe.waves import OneDPart

Length = Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)]
Point = Annotated[
    tuple[float, float, float], Field(description="x, y, z in mm in the tissue's frame")
]
Seed = Annotated[int, Field(ge=0, lt=2**32)]


class Part(BaseModel):
    """Base of all sections."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class NetworkSection(Part):
    """What every network may say."""

    def files(self) -> list[str]:
        """Names of the user's files that the network is made from."""
        return []


def given(value: Any, key: str) -> Any:
    """What a section, as a dict or as a model, says under ``key``; None when it doesn't."""
    return value.get(key) if isinstance(value, dict) else getattr(value, key, None)


class FlowPart(Part):
    """How the network is perfused."""

    viscosity_mpa_s: Annotated[float, Field(gt=0, le=1000)] = 1.0
    inlet_flow_ml_min: Annotated[float, Field(gt=0, le=10_000)] = 0.25
    outlet_pressure_mmhg: Annotated[float, Field(ge=-100, le=1000)] = 0.0
    pulse: PulsePart | None = Field(
        default=None, description="Without it the flow is steady, with it solved both ways."
    )
    one_d: OneDPart | None = Field(
        default=None, description="With it the pulse's waves are followed along vessels, too."
    )

    @model_validator(mode="after")
    def _waves_have_a_wall(self) -> FlowPart:
        if self.one_d is not None and (self.pulse is None or self.pulse.wall_young_kpa is None):
            raise ValueError(
                "one_d follows a pulse in walls that give way; give pulse, with wall_young_kpa"
            )
        return self
