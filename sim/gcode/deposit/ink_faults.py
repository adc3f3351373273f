"""Ink faults during a simulated print, from the fault file's list `ink`.

::

    ink:
      - {fault: clog, written_mm: 120, clears_ul: 0.5}      # nothing comes until 0.5 µL are purged
      - {fault: clog, line: 900, passes: 0.4, lasts_mm: 30} # a partial clog, for 30 mm of line
      - {fault: drift, written_mm: 200, factor: 1.3}        # a step; over_mm: 80 makes it a ramp
      - {fault: temperature, time_s: 0, amplitude: 0.1, period_s: 240}
      - {fault: bubble, pushed_ul: 1.5, ul: 0.05, catches_up: 0.6}
      - {fault: empty, pushed_ul: 40, fades_ul: 1}
      - {fault: lost, line: 400}                            # the stroke written there isn't laid
      - {fault: lost, written_mm: 0, strokes: 100000, share: 0.01}
      - {fault: skip, time_s: 60, shift_mm: [0.3, 0]}
      - {fault: sag, written_mm: 300, percent: 25, drop_mm: 0.1}
      - {fault: debris, written_mm: 50, diameter_mm: 0.4, offset_mm: [0.2, 0.1]}

Each begins at one moment: ``line`` (of the job's commands, from 1; the first that is executed from
there on), ``time_s`` (printer's clock), ``written_mm`` (way of written lines, mends included) or
``pushed_ul`` (pushed by the plunger beyond its foremost place, all syringes together). The motors
know nothing of them: the simulated scanner and camera do (`sim.gcode.deposit.laid`).

A purge is what the plunger pushes beyond its foremost place while the tip stands, or along a way
with at least `PURGE_RATIO` times the job's median dose per mm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

PURGE_RATIO: Final = 2.0
LEAST_PURGE_UL: Final = 0.02
"""Less in a move that stands is the rounding of a prime to motor steps."""
RELOAD_UL: Final = 30.0
"""No retraction is so long: a plunger that goes back farther is put to a full syringe."""

Amount = Annotated[float, Field(ge=0, le=1e6, allow_inf_nan=False)]
More = Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]
Shift = tuple[
    Annotated[float, Field(ge=-100, le=100)],
    Annotated[float, Field(ge=-100, le=100)],
]


class Moment(BaseModel):
    """Where a fault begins: exactly one of four measures, see the module; `head` alone or all."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    line: Annotated[int, Field(ge=1)] | None = None
    time_s: Amount | None = None
    written_mm: Amount | None = None
    pushed_ul: Amount | None = None
    head: Annotated[int, Field(ge=0)] | None = None

    @model_validator(mode="after")
    def _is_one(self) -> Moment:
        given = (self.line, self.time_s, self.written_mm, self.pushed_ul)
        if sum(value is not None for value in given) != 1:
            raise ValueError("give one of line, time_s, written_mm and pushed_ul as the moment")
        return self


class Clog(Moment):
    """The needle lets through the share `passes`: for `lasts_mm`, until purged, or for good."""

    fault: Literal["clog"]
    passes: Annotated[float, Field(ge=0, lt=1)] = 0.0
    lasts_mm: More | None = None
    clears_ul: More | None = Field(default=None, description="A purge of this mends it.")


class Drift(Moment):
    """The flow becomes `factor` times what is pushed: at once, or evenly over `over_mm`."""

    fault: Literal["drift"]
    factor: Annotated[float, Field(gt=0, le=5)]
    over_mm: Amount = 0.0


class Temperature(Moment):
    """The flow swings by `amplitude` about what is pushed, as a heater's swing makes it."""

    fault: Literal["temperature"]
    amplitude: Annotated[float, Field(gt=0, lt=1)]
    period_s: Annotated[float, Field(ge=0.1, le=1e6)]


class Bubble(Moment):
    """Air of `ul` passes in place of ink; of that, `catches_up` comes on top of the next `ul`."""

    fault: Literal["bubble"]
    ul: More
    catches_up: Share = 0.0


class Empty(Moment):
    """The syringe is empty: the flow fades over `fades_ul`, and nothing comes any more."""

    fault: Literal["empty"]
    fades_ul: Amount = 0.0


class Lost(Moment):
    """Strokes don't stick to what is below: of `strokes` from the moment on each by a chance."""

    fault: Literal["lost"]
    strokes: Annotated[int, Field(ge=1)] = 1
    share: Share = 1.0


class Skip(Moment):
    """A motor loses steps: all that is laid from then on is shifted."""

    fault: Literal["skip"]
    shift_mm: Shift


class Sag(Moment):
    """Ink spreads: a layered line becomes wider, a filament in a bath sinks."""

    fault: Literal["sag"]
    percent: Annotated[float, Field(ge=0, le=200)] = 0.0
    drop_mm: Annotated[float, Field(ge=0, le=10)] = 0.0


class Debris(Moment):
    """A clump of ink falls beside the line that is being written."""

    fault: Literal["debris"]
    diameter_mm: Annotated[float, Field(gt=0, le=10)]
    offset_mm: Shift = (0.0, 0.0)


InkFault = Annotated[
    Clog | Drift | Temperature | Bubble | Empty | Lost | Skip | Sag | Debris,
    Field(discriminator="fault"),
]


@dataclass(frozen=True)
class InkFaults:
    """Faults of the ink in a print, and the seed of their chances."""

    each: tuple[InkFault, ...] = ()
    seed: int = 0

    def of_head(self, number: int) -> InkFaults:
        """Those that befall one head."""
        return InkFaults(tuple(one for one in self.each if one.head in (None, number)), self.seed)


NO_FAULTS: Final = InkFaults()
