"""Profile entry for a gauge polled in a print: query, reply pattern, limit that ends the print."""

from __future__ import annotations

import re
from typing import Annotated, Final

from pydantic import Field, field_validator

from firmware_profiles.commands import SwitchCommand
from firmware_profiles.strict_model import StrictModel

_STOPS: Final = frozenset({"M0", "M1", "M108", "M110", "M112", "M410", "M999"})


class WatchedGauge(StrictModel):
    """A force, pressure or the like that the firmware tells when it is asked."""

    query: SwitchCommand = Field(description="The question, e.g. M871; nothing that moves.")
    regex: Annotated[str, Field(min_length=3, max_length=200)] = Field(
        description="Finds the number in the answer, as its one group: 'Force: ([-+.0-9]+)'."
    )
    unit: Annotated[str, Field(min_length=1, max_length=16)] = Field(
        description="Of the number: N, kPa ..."
    )
    high: Annotated[float, Field(allow_inf_nan=False)] = Field(
        description="Above it the print ends by a controlled stop; at rest it must be below."
    )
    every_s: Annotated[float, Field(ge=0.25, le=3600)] = Field(
        default=2.0, description="How often it is asked, between two lines."
    )

    @field_validator("query")
    @classmethod
    def _only_asks(cls, query: str) -> str:
        if query.split()[0].upper() in _STOPS:
            raise ValueError(f"{query!r} stops or renumbers; a question changes nothing")
        return query

    @field_validator("regex")
    @classmethod
    def _has_one_group(cls, regex: str) -> str:
        try:
            groups = re.compile(regex).groups
        except re.error as exc:
            raise ValueError(f"regex {regex!r} is none: {exc}") from exc
        if groups != 1:
            raise ValueError(f"regex {regex!r} has {groups} groups, not one: the number alone")
        return regex
