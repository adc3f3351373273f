"""Dish profile: inner size, round or box shape and wall height of the support bath's dish."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from firmware_profiles.facts import Facts


class Dish(Facts):
    """A dish for the bath, its floor at the bottom of the printer's z."""

    shape: Literal["round", "box"]
    inner_x_mm: Annotated[float, Field(gt=0, le=1000)] = Field(description="Diameter, if round.")
    inner_y_mm: Annotated[float, Field(gt=0, le=1000)] = Field(description="Diameter, if round.")
    wall_mm: Annotated[float, Field(gt=0, le=500)] = Field(
        description="Height of the wall above the floor inside."
    )

    @model_validator(mode="after")
    def _round_is_round(self) -> Dish:
        if self.shape == "round" and self.inner_x_mm != self.inner_y_mm:
            raise ValueError(
                f"a round dish is {self.inner_x_mm:g} mm in x and {self.inner_y_mm:g} mm in y"
            )
        return self
