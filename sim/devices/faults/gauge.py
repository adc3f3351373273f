"""Simulated force or pressure gauge: answers an M command by a ramp over time."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

Number = Annotated[float, Field(allow_inf_nan=False)]


class Gauge(BaseModel):
    """A sensor that a firmware with an M command of its own would tell of.

    Attributes
    ----------
    command : str
        Which asks for it, such as M871.
    says : str
        The answer, with ``{value}`` where the number stands; it may have a format,
        ``{value:.2f}``. An answer without it is one that nobody can read.
    ramp : tuple of (time, value)
        Straight between them by the printer's clock, s; constant before and after.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    command: Annotated[str, Field(pattern=r"^M\d+$")]
    says: Annotated[str, Field(min_length=1, max_length=100)]
    ramp: Annotated[tuple[tuple[Number, Number], ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _can_be_said(self) -> Gauge:
        times = [time for time, _ in self.ramp]
        if times != sorted(set(times)):
            raise ValueError("the ramp's times must ascend")
        try:
            self.at(0.0)
        except (KeyError, IndexError, ValueError) as exc:
            raise ValueError(f"says {self.says!r} can't be filled in with a value: {exc}") from exc
        return self

    def at(self, time_s: float) -> str:
        """The answer at a moment of the printer's clock."""
        times, values = zip(*self.ramp, strict=True)
        return self.says.format(value=float(np.interp(time_s, times, values)))
