"""Base class of recipe sections; sections on flow, its fluid, pulse and oxygen."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from design.lattices import LatticeKind, LatticeOptions
from design.units import BLOOD_MPA_S
from firmware_profiles.strict_model import StrictModel

FILE: Final[dict[str, Any]] = {"file": True}
"""For ``json_schema_extra`` of a path that is relative to the recipe."""
PrinterName = Annotated[
    str,
    Field(
        description="Shipped name or path of a .yaml.", json_schema_extra={"profile": "printers"}
    ),
]
PlateName = Annotated[
    str,
    Field(description="Shipped name or path of a .yaml.", json_schema_extra={"profile": "plates"}),
]
NeedleName = Annotated[str, Field(json_schema_extra={"profile": "needles"})]
SyringeName = Annotated[str, Field(json_schema_extra={"profile": "syringes"})]
InkName = Annotated[str, Field(json_schema_extra={"profile": "inks"})]
BathName = Annotated[str, Field(json_schema_extra={"profile": "baths"})]
DishName = Annotated[str, Field(json_schema_extra={"profile": "dishes"})]


_MPA_S = Field(gt=0, le=1e6)


class CarreauPart(StrictModel):
    """Carreau-Yasuda; without numbers it is blood (Cho & Kensey 1991)."""

    model: Literal["carreau"]
    zero_shear_mpa_s: Annotated[float, _MPA_S] = 56.0
    infinite_shear_mpa_s: Annotated[float, _MPA_S] = 3.45
    time_s: Annotated[float, Field(gt=0, le=1e4)] = 3.313
    index: Annotated[float, Field(ge=0.1, le=1)] = 0.3568
    yasuda: Annotated[float, Field(ge=0.2, le=10)] = 2.0


class PowerLawPart(StrictModel):
    """τ = K γ̇ⁿ."""

    model: Literal["power_law"]
    consistency_mpa_sn: Annotated[float, _MPA_S]
    index: Annotated[float, Field(ge=0.1, le=2)]


class PriesPart(StrictModel):
    """Blood by the diameter, in vivo (Pries et al. 1994), of one haematocrit everywhere."""

    model: Literal["pries_1994"]
    wide_mpa_s: Annotated[float, _MPA_S] = Field(
        default=BLOOD_MPA_S, description="Viscosity in wide vessels."
    )
    haematocrit: Annotated[float, Field(ge=0, le=0.8)] = 0.45


FluidPart = Annotated[CarreauPart | PowerLawPart | PriesPart, Field(discriminator="model")]


class StenosisPart(StrictModel):
    """A short narrow place (Young & Tsai 1973)."""

    vessel: Annotated[int, Field(ge=0)]
    diameter_share: Annotated[float, Field(ge=0.1, le=1)]
    length_mm: Annotated[float, Field(gt=0, le=1000)]


class LossPart(StrictModel):
    """Pressure lost to inertia in steady flow."""

    junction_k: Annotated[float, Field(ge=0, le=100)] = Field(
        default=0.0, description="K of K ϱ u²/2 where a vessel leaves a bifurcation."
    )
    stenoses: tuple[StenosisPart, ...] = ()


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
        default="womersley", description="Pulsatile velocity profile."
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
    steps: Annotated[int, Field(ge=8, le=10_000)] | None = Field(
        default=None,
        description="Of a cycle in 3D, where the flow pulses and fidelities are compared; 24, or "
        "as many as keep a Windkessel's pressure swing within 1 %.",
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


Concentration = Annotated[float, Field(ge=0, le=100)]
Diffusivity = Annotated[float, Field(ge=1e-6, le=1)]


class Part(StrictModel):
    """Base of all sections."""


class OxygenPart(Part):
    """What the medium brings and the cells take; any solute by other numbers.

    The defaults are from the literature (docs/oxygen.md), and the report says so of each.
    """

    inlet_millimolar: Annotated[float, Field(gt=0, le=100)] = Field(
        default=0.2, description="In the medium; 0.2 is oxygen in equilibrium with air at 37 °C."
    )
    cells_per_ml: Annotated[float, Field(gt=0, le=1e10)] = Field(
        default=1e7, description="Of tissue. Assumed: count yours."
    )
    uptake_mol_per_cell_s: Annotated[float, Field(gt=0, le=1e-12)] = Field(
        default=5e-17, description="Greatest uptake of a cell. Assumed: measure yours."
    )
    half_millimolar: Annotated[float, Field(ge=1e-6, le=100)] = Field(
        default=1e-3, description="Where uptake is half of that (Michaelis-Menten)."
    )
    tissue_diffusivity_mm2_s: Diffusivity = Field(
        default=2e-3, description="Of oxygen in tissue at 37 °C."
    )
    medium_diffusivity_mm2_s: Diffusivity = Field(
        default=3e-3, description="Of oxygen in the medium at 37 °C."
    )
    sherwood: Annotated[float, Field(ge=0.1, le=1000)] = Field(
        default=48.0 / 11.0, description="Of what passes from the medium to the vessel's wall."
    )
    threshold_millimolar: Concentration = Field(
        default=0.01, description="Tissue below it counts as hypoxic."
    )
    bath_millimolar: Concentration | None = Field(
        default=None, description="At the tissue's surface; without it nothing passes there."
    )
    spacing_um: Annotated[float, Field(ge=1, le=10_000)] | None = Field(
        default=None, description="Of the grid; without it, about grid_cells cells."
    )
    grid_cells: Annotated[int, Field(ge=1000, le=40_000_000)] = Field(
        default=1_000_000, description="About so many, without spacing_um."
    )

    @model_validator(mode="after")
    def _one_size(self) -> OxygenPart:
        if self.spacing_um is not None and "grid_cells" in self.model_fields_set:
            raise ValueError("give spacing_um or grid_cells, and not both: either sets the other")
        return self


Length = Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)]
Point = Annotated[
    tuple[float, float, float], Field(description="x, y, z in mm in the tissue's frame")
]
Seed = Annotated[int, Field(ge=0, lt=2**32)]


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
