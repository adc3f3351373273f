"""Dispenser section of a printer profile: plunger on E, or air pressure with a switched valve."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from firmware_profiles.errors import ProfileError
from firmware_profiles.materials.inks_and_baths import Ink
from firmware_profiles.materials.rheology import flow_ul_s, yield_pressure_pa
from firmware_profiles.strict_model import (
    PRESSURE_UNITS,
    FileLine,
    StrictModel,
    SwitchCommand,
    check_values,
    switched,
)
from firmware_profiles.tools import Needle

Kilopascal = Annotated[float, Field(gt=0, le=2000, allow_inf_nan=False)]
Delay = Annotated[float, Field(ge=0, le=5, allow_inf_nan=False)]


class Plunger(StrictModel):
    """A plunger that E moves, E in mm of its travel."""

    kind: Literal["plunger"] = "plunger"


class MeasuredFlow(StrictModel):
    """What came out, by weight; good for this pressure, ink and needle alone."""

    flow_ul_s: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    pressure_kpa: Kilopascal
    ink: str = Field(min_length=1, description="The ink profile's `name`.")
    needle: str = Field(min_length=1, description="The needle profile's `name`.")


PRESSURE_SETTLES_S: Final = 1.0
"""Waited for where a pressure is set: electronic regulators take some tenths of a second."""


class Pneumatic(StrictModel):
    """Air on the ink, let in by a valve that G-code switches.

    The flow follows from pressure, needle and ink, so the writing speed follows from the flow. The
    pressure is set by hand, or by the job's file (`sets_pressure`).
    """

    kind: Literal["pneumatic"]
    pressure_kpa: Kilopascal = Field(description="What the regulator is set to, above ambient.")
    max_pressure_kpa: Kilopascal = Field(description="What the regulator can give.")
    opens: SwitchCommand = Field(
        description="Opens the valve, e.g. M42 P4 S255; $DO[0].X=1 or BRAKE Aa 0 on an Aerotech "
        "A3200, DriveBrakeOff(Aa) on an Automation1."
    )
    closes: SwitchCommand = Field(description="Closes it; the same command with another value.")
    enables: FileLine | None = Field(
        default=None,
        description="Line that enables the axis whose brake is the valve, written right before "
        "each opening, e.g. Enable Aa: a controller may let the brake go by itself there.",
    )
    opening_delay_s: Delay = Field(description="From the command until ink flows.")
    closing_delay_s: Delay = Field(description="From the command until none flows any more.")
    measured: MeasuredFlow | None = Field(
        default=None, description="Written by `printctl calibrate weigh`."
    )
    sets_pressure: Annotated[tuple[FileLine, ...], Field(max_length=8)] = Field(
        default=(),
        description="Lines that set this head's pressure, with {kpa}, {psi} or {bar} in them, or "
        "{output}: the firmware's number for an output, 0 to max_pressure_kpa. One line where a "
        "host sends it (M42 P3 S{output}); more for a controller that runs the file ([$COM=2, "
        "'$AP={psi}', Call setPress P$COM Q$AP]). Without them a person sets it.",
    )
    resting_kpa: Annotated[float, Field(ge=0, le=2000, allow_inf_nan=False)] | None = Field(
        default=None, description="Set while another head writes; needed with sets_pressure."
    )

    @property
    def valve(self) -> frozenset[str]:
        """What both commands have in common: a pin, an output, a brake."""
        return switched(self.opens, self.closes)

    @property
    def port(self) -> frozenset[str]:
        """What sets its pressure, whatever the pressure; empty where a person does."""
        lines = "\n".join(self.sets_pressure)
        if not re.match(r"M\d|[A-Za-z]+_", lines):  # a controller's own that runs the file
            return frozenset(re.findall(r"[^\s(),=]+", re.sub(r"\{\w+\}", "", lines.upper())))
        one, other = (re.sub(r"\{\w+\}", value, lines) for value in "12")
        return switched(one, other)

    @model_validator(mode="after")
    def _is_possible(self) -> Pneumatic:
        if self.pressure_kpa > self.max_pressure_kpa:
            raise ValueError(
                f"pressure_kpa {self.pressure_kpa:g} is above what the regulator gives, "
                f"{self.max_pressure_kpa:g} kPa (max_pressure_kpa); lower it"
            )
        check_values("sets_pressure", self.sets_pressure, (*PRESSURE_UNITS, "output"))
        if self.sets_pressure and "".join(self.sets_pressure).count("{") != 1:
            raise ValueError("sets_pressure holds one value: {kpa}, {psi}, {bar} or {output}, once")
        if bool(self.sets_pressure) != (self.resting_kpa is not None):
            raise ValueError(
                "sets_pressure and resting_kpa belong together: give both, or neither where a "
                "person sets the pressure"
            )
        if (self.resting_kpa or 0.0) > self.pressure_kpa:
            raise ValueError(
                f"resting_kpa {self.resting_kpa:g} is above pressure_kpa {self.pressure_kpa:g}, at "
                "which it writes; lower it"
            )
        switched(self.opens, self.closes)
        return self


Dispenser = Annotated[Plunger | Pneumatic, Field(discriminator="kind")]


@dataclass(frozen=True)
class SteadyFlow:
    """Flow rate while the valve is open.

    Attributes
    ----------
    ul_s : float, µL/s
        What comes out.
    measured : bool
        By weight, at this pressure with this ink and needle; else it is foreseen from the ink's
        viscosity.
    """

    ul_s: float
    measured: bool


def steady_flow(head: Pneumatic, ink: Ink, needle: Needle) -> SteadyFlow:
    """Flow through the needle at the head's pressure, times the ink's flow factor if foreseen.

    Raises
    ------
    ProfileError
        When the pressure doesn't overcome the ink's yield stress.
    """
    measured = head.measured
    fits = measured is not None and (measured.ink, measured.needle) == (ink.name, needle.name)
    if measured is not None and fits and measured.pressure_kpa == head.pressure_kpa:
        return SteadyFlow(measured.flow_ul_s, True)
    flow = flow_ul_s(ink, needle, head.pressure_kpa * 1e3) * ink.flow_factor
    if flow <= 0:
        raise ProfileError(
            f"{head.pressure_kpa:g} kPa (dispenser: pressure_kpa) don't move {ink.name} through "
            f"{needle.name}: its yield stress holds "
            f"{yield_pressure_pa(ink, needle) * 1e-3:.4g} kPa; "
            "raise the pressure, or take a wider or shorter needle"
        )
    return SteadyFlow(flow, False)
