"""The sections of a recipe, each typed and bounded; an unknown key is refused.

Every number carries its unit in its key. Lengths of tissue are mm, of writing µm where the lab
says µm; flows mL/min and pressures mmHg as the lab says them. They are converted once, in the
pipeline.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator

from design.units import LengthUnit
from printctl.recipe.lattice import LatticeNetwork

Length = Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)]
Point = Annotated[
    tuple[float, float, float], Field(description="x, y, z in mm in the tissue's frame")
]
Seed = Annotated[int, Field(ge=0, lt=2**32)]


class Part(BaseModel):
    """Base of all sections."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def given(value: Any, key: str) -> Any:
    """What a section, as a dict or as a model, says under ``key``; None when it doesn't."""
    return value.get(key) if isinstance(value, dict) else getattr(value, key, None)


class NamedNetwork(Part):
    """A network shipped with the product."""

    design: Literal["planar_four_vessel"]


class GivenNetwork(Part):
    """A network from a CSV file of pieces."""

    network: str = Field(min_length=1, description="Path, relative to the recipe.")
    unit: LengthUnit = Field(description="Unit of the coordinates; radii are mm, as named.")
    clearance_mm: float = Field(default=0.0, ge=0, le=10, description="Least wall between vessels.")


class Growth(Part):
    """What every grown tree is told."""

    terminals: Annotated[int, Field(ge=1, le=20_000_000)] = Field(description="Of each tree.")
    murray_exponent: Annotated[float, Field(ge=2, le=3.5)] = 3.0
    viscosity_mpa_s: Annotated[float, Field(gt=0, le=1000)] = 4.0
    pressure_drop_mmhg: Annotated[float, Field(gt=0, le=1000)] = 40.0
    perfusion_ml_min_per_ml: Annotated[float, Field(gt=0, le=100)] = 0.8
    smallest_diameter_mm: Annotated[float, Field(gt=0, le=10)] | None = Field(
        default=None, description="Fixes the smallest lumen; the pressure drop follows."
    )
    clearance_mm: float = Field(default=0.1, ge=0, le=10)
    root_mm: Point | None = None
    root_direction: Point | None = None


class GrownNetwork(Growth):
    """A tree grown by constrained constructive optimisation."""

    grow: Literal["tree"]
    polish: bool = Field(
        default=False, description="Relax and regraft the grown tree to lower its volume."
    )

    @model_validator(mode="after")
    def _polish_keeps_no_smallest_lumen(self) -> GrownNetwork:
        if self.polish and self.smallest_diameter_mm is not None:
            raise ValueError(
                "polish thins the smallest lumens by some percent, so it can't be combined with "
                "smallest_diameter_mm yet; give one of the two"
            )
        return self


class ClosedLoop(Growth):
    """An arterial and a venous tree that don't touch, their terminals joined by smooth curves."""

    grow: Literal["closed_loop"]
    vein_root_mm: Point | None = Field(
        default=None, description="As far from the artery's root as the surface allows by default."
    )
    vein_root_direction: Point | None = None


def _network_kind(value: Any) -> str:
    grown = given(value, "grow")
    if grown is not None:
        return f"grow: {grown}"
    return next(
        (key for key in ("design", "network", "lattice") if given(value, key) is not None), "none"
    )


NetworkPart = Annotated[
    Annotated[NamedNetwork, Tag("design")]
    | Annotated[GivenNetwork, Tag("network")]
    | Annotated[LatticeNetwork, Tag("lattice")]
    | Annotated[GrownNetwork, Tag("grow: tree")]
    | Annotated[ClosedLoop, Tag("grow: closed_loop")],
    Discriminator(_network_kind),
]


class FlowPart(Part):
    """How the network is perfused."""

    viscosity_mpa_s: Annotated[float, Field(gt=0, le=1000)] = 1.0
    inlet_flow_ml_min: Annotated[float, Field(gt=0, le=10_000)] = 0.25
    outlet_pressure_mmhg: Annotated[float, Field(ge=-100, le=1000)] = 0.0
