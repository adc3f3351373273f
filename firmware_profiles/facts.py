"""Pydantic base class of profiles (name, source, licence, starting values); bounded number types.

A profile holds facts with their source, not a user's taste.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, Field, model_validator

from firmware_profiles.strict_model import StrictModel

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Celsius = Annotated[float, Field(ge=-80, le=300)]
Trigger = Literal["neutral_ph", "calcium", "thrombin"]
"""What makes an ink set in the bath while it is printed."""
CommandName = Annotated[str, Field(pattern=r"^([GMT]\d+|[A-Za-z]+_\w+)$")]


class Facts(StrictModel):
    """Base of all profiles: unknown keys are refused, values can't be changed."""

    name: str = Field(min_length=1, description="Name shown to the user.")
    source: str = Field(min_length=1, description="Where the numbers come from.")
    licence: str = Field(min_length=1, description="Licence of the numbers.")
    starting_values: tuple[str, ...] = Field(
        default=(),
        description="Keys whose numbers have no source: measure them, or compare with the "
        "machine's own, before the first print.",
    )

    @model_validator(mode="after")
    def _starting_values_are_keys(self) -> Facts:
        for name in self.starting_values:
            key, _, part = name.partition(".")
            value = getattr(self, key, None) if key in type(self).model_fields else None
            inside = isinstance(value, BaseModel) and part in type(value).model_fields
            if key not in type(self).model_fields or (part and not inside):
                raise ValueError(
                    f"starting_values names {name!r}, which is no key of this sort of profile"
                )
        return self


class Span(StrictModel):
    """Lowest and highest value."""

    low: Annotated[float, Field(allow_inf_nan=False)]
    high: Annotated[float, Field(allow_inf_nan=False)]

    @model_validator(mode="after")
    def _ordered(self) -> Span:
        if not self.low < self.high:
            raise ValueError(f"low {self.low:g} isn't below high {self.high:g}")
        return self
