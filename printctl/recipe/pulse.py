"""Recipe section on pulsatile flow: inlet waveform, outlet Windkessels, compliant walls."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from firmware_profiles.strict_model import StrictModel
from printctl.recipe.marks import FILE

Resistance = Annotated[float, Field(gt=0, le=1e9, allow_inf_nan=False)]


class PulseOutlet(StrictModel):
    """What lies behind every outlet: a resistance, or with a compliance a Windkessel."""

    resistance_mmhg_min_ml: Resistance = Field(
        description="Behind every outlet; of a Windkessel, the distal one."
    )
    proximal_mmhg_min_ml: Resistance | None = Field(
        default=None, description="Of a Windkessel, before its compliance."
    )
    compliance_ml_mmhg: Annotated[float, Field(gt=0, le=1e6)] | None = Field(
        default=None, description="Of a Windkessel."
    )

    @model_validator(mode="after")
    def _whole(self) -> PulseOutlet:
        if (self.proximal_mmhg_min_ml is None) != (self.compliance_ml_mmhg is None):
            raise ValueError(
                "a Windkessel has proximal_mmhg_min_ml, compliance_ml_mmhg and "
                "resistance_mmhg_min_ml (its distal one); give all three, or the last alone"
            )
        return self


class PulsePart(StrictModel):
    """How the flow at the inlet changes over a cycle, and what the walls give way to."""

    amplitude_ml_min: Annotated[float, Field(gt=0, le=10_000)] | None = Field(
        default=None, description="Of a sine about inlet_flow_ml_min."
    )
    amplitude_mmhg: Annotated[float, Field(gt=0, le=1e5)] | None = Field(
        default=None, description="Of a sine about inlet_pressure_mmhg."
    )
    shape: Literal["ejection", "kassab", "roller_pump"] | None = Field(
        default=None,
        description="Scaled to the inlet's mean; kassab: coronary (Huo & Kassab 2006).",
    )
    table: str | None = Field(
        default=None,
        json_schema_extra=FILE,
        description="CSV with time_s and flow_ml_min or, where the inlet's pressure is given, "
        "pressure_mmhg over one cycle, of the inlet's mean.",
    )
    period_s: Annotated[float, Field(gt=0, le=1e5)] | None = Field(
        default=None, description="Of a sine or a shape; of a table whose end isn't its begin."
    )
    wall_young_kpa: Annotated[float, Field(gt=0, le=1e9)] | None = Field(
        default=None, description="Of the gel around the lumens; without it walls are rigid."
    )
    wall_thickness_mm: Annotated[float, Field(gt=0, le=100)] | None = Field(
        default=None, description="Of free tubes, where the lumens aren't in thick gel."
    )
    profile: Literal["womersley", "poiseuille"] = Field(
        default="womersley", description="Of the pulse's velocity."
    )
    outlet: PulseOutlet | None = Field(
        default=None, description="The same as flow.outlet, for steady flow, too; one may be given."
    )
    steps: Annotated[int, Field(ge=8, le=10_000)] = Field(default=100, description="Of a cycle.")

    @model_validator(mode="after")
    def _one_wave(self) -> PulsePart:
        waves = (self.amplitude_ml_min, self.amplitude_mmhg, self.shape, self.table)
        if sum(x is not None for x in waves) != 1:
            raise ValueError("give one of amplitude_ml_min, amplitude_mmhg, shape and table")
        if self.table is None and self.period_s is None:
            raise ValueError("give period_s, the length of a cycle")
        if self.wall_thickness_mm is not None and self.wall_young_kpa is None:
            raise ValueError("wall_thickness_mm needs wall_young_kpa")
        return self
