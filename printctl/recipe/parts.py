"""Base class of recipe sections, and the recipe section on flow in the network.

Every number carries its unit in its key. Lengths of tissue are mm, of writing µm where the lab
says µm; flows mL/min and pressures mmHg as the lab says them. They are converted once, in the
pipeline.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from design.units import BLOOD_MPA_S
from firmware_profiles.strict_model import StrictModel
from printctl.recipe.fluids import FluidPart, LossPart
from printctl.recipe.marks import FILE
from printctl.recipe.pulse import PulseOutlet, PulsePart
from printctl.recipe.space import ComparePart, ThreeDPart
from printctl.recipe.waves import OneDPart

Length = Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)]
Point = Annotated[
    tuple[float, float, float], Field(description="x, y, z in mm in the tissue's frame")
]
Seed = Annotated[int, Field(ge=0, lt=2**32)]


class Part(StrictModel):
    """Base of all sections."""


class NetworkSection(Part):
    """What every network may say."""

    def files(self) -> list[str]:
        """Names of the user's files that the network is made from."""
        return []


def value_given(value: Any, key: str) -> Any:
    """What a section, as a dict or as a model, says under ``key``; None when it doesn't."""
    return value.get(key) if isinstance(value, dict) else getattr(value, key, None)


Export = Literal["svzerod", "svoned", "svmultiphysics"]


class SupplyPart(Part):
    """Inlets of some trees, on a supply of their own; its flow is steady."""

    trees: Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1)] = Field(
        description="Numbers, as flow.csv has them: 0 is the first."
    )
    flow_ml_min: Annotated[float, Field(gt=0, le=10_000)]


class FlowPart(Part):
    """How the network is perfused."""

    viscosity_mpa_s: Annotated[float, Field(gt=0, le=1000)] = Field(
        default=BLOOD_MPA_S, description="Of a Newtonian fluid; the default is blood's."
    )
    viscosity: FluidPart | None = Field(
        default=None, description="Of a fluid with more than one; in place of viscosity_mpa_s."
    )
    density_g_cm3: Annotated[float, Field(ge=0.1, le=20)] = Field(
        default=1.06, description="Of pulses, 3D flow, losses, Reynolds numbers; g/cm³."
    )
    inlet_flow_ml_min: Annotated[float, Field(gt=0, le=10_000)] = Field(
        default=0.25, description="Mean, of all inlets together."
    )
    inlet_pressure_mmhg: Annotated[float, Field(ge=-1000, le=1e6)] | None = Field(
        default=None, description="Mean; in place of inlet_flow_ml_min."
    )
    supplies: tuple[SupplyPart, ...] = Field(
        default=(),
        max_length=1000,
        description="Of trees that don't hang on the inlet above: lymph, or a second circuit.",
    )
    outlet_pressure_mmhg: Annotated[float, Field(ge=-100, le=1000)] = Field(
        default=0.0, description="At every outlet, or behind what lies there."
    )
    outlet: PulseOutlet | None = Field(
        default=None, description="A resistance behind every outlet, or a Windkessel."
    )
    outlets: str | None = Field(
        default=None,
        json_schema_extra=FILE,
        description="CSV with a row for each outlet: node or vessel, and pressure_mmhg or "
        "resistance_mmhg_min_ml (and proximal_mmhg_min_ml, compliance_ml_mmhg).",
    )
    losses: LossPart = LossPart()
    shear_band_dyn_cm2: (
        Annotated[
            tuple[float, float], Field(description="Least and greatest wall shear wanted, dyn/cm².")
        ]
        | None
    ) = None
    pulse: PulsePart | None = Field(
        default=None, description="Without it the flow is steady, with it solved both ways."
    )
    one_d: OneDPart | None = Field(
        default=None, description="With it the pulse's waves are followed along vessels, too."
    )
    three_d: ThreeDPart | None = Field(
        default=None, description="With it the flow is resolved in the lumens' space, too."
    )
    compare: ComparePart | None = Field(
        default=None, description="Fidelities side by side, each against the ideal."
    )

    exports: tuple[Export, ...] = Field(
        default=(), description="Inputs of other solvers, written into the run folder."
    )

    @model_serializer(mode="wrap")
    def _as_read(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out what another key displaces, so that what is written can be read again."""
        data: dict[str, Any] = handler(self)
        displaced = {"inlet_pressure_mmhg": "inlet_flow_ml_min", "viscosity": "viscosity_mpa_s"}
        left_out = {key for given, key in displaced.items() if getattr(self, given) is not None}
        return {key: value for key, value in data.items() if key not in left_out}

    @property
    def every_outlet(self) -> PulseOutlet | None:
        """What lies behind every outlet, wherever it is said; in steady flow and in pulses."""
        return self.outlet or (None if self.pulse is None else self.pulse.outlet)

    @model_validator(mode="after")
    def _one_of_each(self) -> FlowPart:
        given = self.model_fields_set
        for one, other in (
            ("inlet_pressure_mmhg", "inlet_flow_ml_min"),
            ("viscosity", "viscosity_mpa_s"),
            ("outlet", "outlets"),
        ):
            if getattr(self, one) is not None and other in given and getattr(self, other):
                raise ValueError(f"give {one} or {other}, and not both")
        self._check_pulse()
        self._check_supplies()
        self._waves_have_a_wall()
        self._check_space()
        band = self.shear_band_dyn_cm2
        if band is not None and not 0.0 <= band[0] < band[1]:
            raise ValueError(
                f"shear_band_dyn_cm2 goes from {band[0]:g} to {band[1]:g}; let it rise"
            )
        return self

    def _check_pulse(self) -> None:
        if self.pulse is None:
            return
        by_pressure = self.inlet_pressure_mmhg is not None
        if by_pressure and self.pulse.amplitude_ml_min is not None:
            raise ValueError("inlet_pressure_mmhg goes with amplitude_mmhg, not amplitude_ml_min")
        if not by_pressure and self.pulse.amplitude_mmhg is not None:
            raise ValueError("amplitude_mmhg needs inlet_pressure_mmhg")
        if self.pulse.outlet is not None and (self.outlet or self.outlets):
            raise ValueError("give outlet or outlets, or pulse.outlet, and not both")
        swing = self.pulse.amplitude_ml_min
        if swing is not None and swing > self.inlet_flow_ml_min:
            raise ValueError(
                f"amplitude_ml_min is {swing:g} and inlet_flow_ml_min {self.inlet_flow_ml_min:g}: "
                "the flow would go back out of the inlet; lower the one, raise the other, or drive "
                "the inlet by pressure"
            )
        if self.viscosity is not None or self.losses != LossPart():
            raise ValueError(
                "a pulse is solved with viscosity_mpa_s and no losses; leave viscosity and losses "
                "out, or the pulse"
            )

    def _check_supplies(self) -> None:
        named = [tree for supply in self.supplies for tree in supply.trees]
        twice = [tree for tree in named if named.count(tree) > 1]
        if twice:
            raise ValueError(f"supplies name tree {twice[0]} twice; name it in one")
        if self.supplies and (self.one_d is not None or self.three_d is not None):
            raise ValueError(
                "one_d and three_d know one supply for all inlets; leave supplies out, or them"
            )

    def _check_space(self) -> None:
        alone = self.three_d is None and self.one_d is None
        if self.compare is not None and alone and self.compare.lattice is None:
            raise ValueError(
                "compare sets other fidelities against the ideal, or a lattice beside the network; "
                "give three_d, one_d or compare.lattice, too"
            )
        if self.three_d is not None and (self.viscosity is not None or self.losses != LossPart()):
            raise ValueError(
                "three_d is solved with viscosity_mpa_s, and finds losses by itself; leave "
                "viscosity and losses out, or three_d"
            )

    def _waves_have_a_wall(self) -> None:
        if self.one_d is not None and (self.pulse is None or self.pulse.wall_young_kpa is None):
            raise ValueError(
                "one_d follows a pulse in walls that give way; give pulse, with wall_young_kpa"
            )
