"""Profiles of dishes and well plates: inner size, shape, wall height; grid and names of wells."""

from __future__ import annotations

from string import ascii_uppercase
from typing import Annotated, Literal

from pydantic import Field, model_validator

from firmware_profiles.strict_model import Facts

Millimetres = Annotated[float, Field(gt=0, le=500, allow_inf_nan=False)]
_TINY_MM = 1e-6


class Plate(Facts):
    """A well plate, the floors of its wells at the bottom of the printer's z."""

    length_mm: Millimetres = Field(description="Outside, along the columns' numbers.")
    width_mm: Millimetres = Field(description="Outside, along the rows' letters.")
    height_mm: Millimetres = Field(
        description="Outside, from the table to the highest rim; travels clear it."
    )
    rows: Annotated[int, Field(ge=1, le=len(ascii_uppercase))]
    columns: Annotated[int, Field(ge=1, le=99)]
    pitch_x_mm: Millimetres = Field(description="From column to column, centre to centre.")
    pitch_y_mm: Millimetres = Field(description="From row to row.")
    a1_x_mm: Millimetres = Field(description="Centre of A1 from the plate's left edge.")
    a1_y_mm: Millimetres = Field(description="Centre of A1 from the plate's edge behind.")
    shape: Literal["round", "box"] = Field(description="Of a well.")
    well_x_mm: Millimetres = Field(description="Inside, where narrowest; diameter, if round.")
    well_y_mm: Millimetres = Field(description="Inside, where narrowest; diameter, if round.")
    well_depth_mm: Millimetres = Field(description="From the floor inside to the well's rim.")

    @model_validator(mode="after")
    def _wells_fit(self) -> Plate:
        if self.shape == "round" and self.well_x_mm != self.well_y_mm:
            raise ValueError(
                f"a round well is {self.well_x_mm:g} mm in x and {self.well_y_mm:g} mm in y"
            )
        if self.well_depth_mm > self.height_mm:
            raise ValueError(
                f"well_depth_mm {self.well_depth_mm:g} is above height_mm {self.height_mm:g}"
            )
        self._check_along("x", self.columns, self.length_mm)
        self._check_along("y", self.rows, self.width_mm)
        return self

    def _check_along(self, axis: str, count: int, outside_mm: float) -> None:
        pitch, well, first = (
            float(getattr(self, name.format(axis)))
            for name in ("pitch_{}_mm", "well_{}_mm", "a1_{}_mm")
        )
        if count > 1 and well >= pitch:
            raise ValueError(
                f"wells of {well:g} mm (well_{axis}_mm) don't fit beside each other at a pitch of "
                f"{pitch:g} mm (pitch_{axis}_mm)"
            )
        low, high = first - well / 2, first + (count - 1) * pitch + well / 2
        if low < -_TINY_MM or high > outside_mm + _TINY_MM:
            raise ValueError(
                f"wells reach from {low:g} to {high:g} mm along {axis}, beyond the plate's "
                f"{outside_mm:g} mm; mend a1_{axis}_mm, pitch_{axis}_mm or the count"
            )

    @property
    def wells(self) -> tuple[str, ...]:
        """Names of all wells, along the rows, from A1."""
        return tuple(
            f"{ascii_uppercase[row]}{column + 1}"
            for row in range(self.rows)
            for column in range(self.columns)
        )

    def offset_mm(self, well: str) -> tuple[float, float]:
        """A well's centre from the plate's middle: to the right, and to behind, mm."""
        row, column = ascii_uppercase.index(well[0]), int(well[1:]) - 1
        right = self.a1_x_mm + column * self.pitch_x_mm - self.length_mm / 2
        behind = self.width_mm / 2 - self.a1_y_mm - row * self.pitch_y_mm
        return right, behind

    def dish(self, *, sideways: bool = False) -> Dish:
        """One of its wells as a dish; ``sideways`` where the plate stands turned by a quarter."""
        x, y = self.well_x_mm, self.well_y_mm
        return Dish(
            name=f"a well of {self.name}",
            source=self.source,
            licence=self.licence,
            shape=self.shape,
            inner_x_mm=y if sideways else x,
            inner_y_mm=x if sideways else y,
            wall_mm=self.well_depth_mm,
        )


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
