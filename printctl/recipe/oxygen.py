"""Recipe section on oxygen: supply by the perfused medium, uptake by the tissue's cells."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from printctl.recipe.parts import Part

Concentration = Annotated[float, Field(ge=0, le=100)]
Diffusivity = Annotated[float, Field(ge=1e-6, le=1)]


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
