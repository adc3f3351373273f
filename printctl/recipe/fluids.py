"""Recipe section on the fluid: viscosity law and inertial pressure losses."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from design.units import BLOOD_MPA_S
from firmware_profiles.strict_model import StrictModel

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
