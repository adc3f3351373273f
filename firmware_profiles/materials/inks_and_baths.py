"""Ink and support bath profiles: rheology, density, temperatures, measured corrections."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Final, Literal

from pydantic import Field, model_validator

from firmware_profiles.strict_model import (
    BeadShape,
    Celsius,
    Facts,
    MeasuredExcess,
    NonNegative,
    Positive,
    Span,
    StrictModel,
    Trigger,
)

if TYPE_CHECKING:
    from firmware_profiles.materials.bead import BeadSection


InkRole = Literal["structural", "cell_laden", "sacrificial"]
BathRole = Literal["support", "matrix"]


def check_viability(minutes: float | None, source: str | None) -> None:
    """Raise ValueError for one without the other."""
    if (minutes is None) != (source is None):
        raise ValueError(
            "viability_min and viability_source go together: say how long, and where that "
            "comes from (a paper, your own live/dead counts)"
        )


class MeasuredLag(StrictModel):
    """How long the flow takes to follow the plunger; good for this needle and syringe alone."""

    lag_s: Annotated[float, Field(gt=0, le=100, allow_inf_nan=False)] = Field(
        description="τ of τ dQ/dt = Q_in - Q."
    )
    needle: str = Field(min_length=1, description="The needle profile's `name`.")
    syringe: str = Field(min_length=1, description="The syringe profile's `name`.")


class Ink(Facts):
    """A bioink."""

    role: InkRole | None = Field(
        default=None,
        description="structural: stays as the part; cell_laden: stays, with cells in it; "
        "sacrificial: melted or dissolved after printing, so that it leaves a lumen. Unknown "
        "without.",
    )
    viscosity_pa_s: Positive = Field(
        description="At flow_index 1; else the consistency K of a power law, Pa s^n."
    )
    flow_index: Annotated[float, Field(gt=0.05, le=1.5)] = Field(
        default=1.0, description="n of shear stress = K (shear rate)^n; 1 is Newtonian."
    )
    yield_stress_pa: NonNegative = Field(
        default=0.0,
        description="Below it the ink stands: Herschel-Bulkley's, shear stress = this + "
        "K (shear rate)^n.",
    )
    max_shear_stress_pa: Positive | None = Field(
        default=None, description="At the needle's wall, for the cells in it; unknown without."
    )
    flow_factor: Annotated[float, Field(gt=0.2, le=5)] = Field(
        default=1.0,
        description="What comes out over what is pushed; the plunger is driven farther by it.",
    )
    lag: MeasuredLag | None = Field(
        default=None,
        description="Written by `printctl calibrate lag`; unknown without, and then the dry run "
        "predicts what lies in the bath without a lag.",
    )
    swell_factor: Annotated[float, Field(gt=0.3, le=3, allow_inf_nan=False)] | None = Field(
        default=None,
        description="Diameter of a filament that has lain in the bath over the one that was "
        "written; not measured without, and taken as 1.",
    )
    bead: BeadShape | MeasuredExcess = Field(
        default="rounded",
        description="Cross-section of a line in a layer: rounded, rectangle, ellipse, or by how "
        "many µm it was measured to be wider than its area over its height.",
    )
    smallest_gap_mm: Positive | None = Field(
        default=None,
        description="Smallest gap between two written lines that stays open (printctl calibrate "
        "pattern comb); unknown without.",
    )
    gelled_by: tuple[Trigger, ...] = Field(
        default=(), description="What the bath must provide for the ink to set."
    )
    density_g_cm3: Annotated[float, Field(gt=0.5, le=3)]
    temperature_c: Span = Field(description="Held while printing.")
    write_speed_mm_s: Span | None = Field(
        default=None,
        description="Speeds at which a written line holds together; unknown without.",
    )
    retract_ul: NonNegative = Field(description="Plunger relief at the end of a written path.")
    plunger_ul_s: Positive = Field(description="Flow while priming and relieving.")
    dwell_s: Annotated[float, Field(ge=0, le=60, allow_inf_nan=False)] = Field(
        default=0.0,
        description="Pause after a prime, until the ink flows, where vessels or a prime line are "
        "written.",
    )
    viability_min: Positive | None = Field(
        default=None,
        description="How long the ink may take from the syringe's filling to the print's end for "
        "its cells' sake; unknown without.",
    )
    viability_source: str | None = Field(
        default=None, min_length=1, description="Where viability_min comes from."
    )
    calibrated: bool = Field(description="Whether the constants were measured on a printer.")

    @property
    def bead_section(self) -> BeadSection:
        """Model of a line's cross-section."""
        from firmware_profiles.materials.bead import BeadSection  # NumPy, which a link does without

        return BeadSection(self.bead)

    @model_validator(mode="after")
    def _a_viability_budget_has_a_source(self) -> Ink:
        check_viability(self.viability_min, self.viability_source)
        return self


class Bath(Facts):
    """A support bath, or the cell matrix that a network is written into."""

    role: BathRole | None = Field(
        default=None,
        description="support: holds the print and is melted or dissolved afterwards; matrix: stays "
        "around what is written into it. Unknown without.",
    )
    yield_stress_pa: Positive
    viscosity_pa_s: Positive | None = Field(
        default=None,
        description="Plastic viscosity above the yield stress (Bingham's); says how fast a "
        "filament sinks that isn't held. Unknown without.",
    )
    recovery_s: Positive | None = Field(
        default=None,
        description="How long the bath takes to close behind the needle; unknown without.",
    )
    density_g_cm3: Annotated[float, Field(gt=0.5, le=3)]
    max_printing_c: Celsius
    melt_out_c: Celsius | None = None
    floor_clearance_mm: NonNegative = Field(
        description="Kept between the needle's tip and the dish."
    )
    provides: tuple[Trigger, ...] = Field(
        default=(), description="What sets an ink in it (buffer, calcium, thrombin)."
    )
    calibrated: bool


GRAVITY: Final = 9.81  # m/s²
HELD: Final = 0.07
"""Yield stress over (density difference × g × diameter) at which a horizontal filament stays."""


def weight_in_bath_n_m3(bath: Bath, ink: Ink) -> float:
    """Weight of the ink less that of the bath in its place, N/m³; below 0 where it floats."""
    return (ink.density_g_cm3 - bath.density_g_cm3) * 1e3 * GRAVITY


def supported_diameter_mm(bath: Bath, ink: Ink) -> float:
    """Thickest horizontal filament of an ink that neither sinks nor floats, mm.

    Infinite without a difference of densities.
    D = τ_y / (0.07 Δρ g), Δρ between ink and bath: Grosskopf et al., ACS Appl. Mater. Interfaces 10
    (2018) 23353; Friedrich & Gunther. It is statics: the crevice behind the needle, surface tension
    and the bath's recovery limit more, and are no part of it.
    """
    weight = abs(weight_in_bath_n_m3(bath, ink))
    return math.inf if weight == 0 else bath.yield_stress_pa / (HELD * weight) * 1e3
