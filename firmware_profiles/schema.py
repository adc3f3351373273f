"""What a profile says: facts about a machine or a material, each typed and bounded.

A profile holds facts with their source, not a user's taste.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Celsius = Annotated[float, Field(ge=-80, le=300)]


class Facts(BaseModel):
    """Base of all profiles: unknown keys are refused, values can't be changed."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = Field(min_length=1, description="Name shown to the user.")
    source: str = Field(min_length=1, description="Where the numbers come from.")
    licence: str = Field(min_length=1, description="Licence of the numbers.")


class Axes(BaseModel):
    """One number for each axis; e is the plunger."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    x: Positive
    y: Positive
    z: Positive
    e: Positive


class Span(BaseModel):
    """Lowest and highest value."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    low: Annotated[float, Field(allow_inf_nan=False)]
    high: Annotated[float, Field(allow_inf_nan=False)]

    @model_validator(mode="after")
    def _ordered(self) -> Span:
        if not self.low < self.high:
            raise ValueError(f"low {self.low:g} isn't below high {self.high:g}")
        return self


class Printer(Facts):
    """A printer: its firmware, its limits and how it counts.

    E is the plunger's travel in mm on every printer of ours.
    """

    firmware: Literal["marlin", "prusa", "reprapfirmware", "klipper", "smoothieware"] = Field(
        description="Firmware family, which sets the protocol. All but marlin are built after "
        "public sources and not verified against a real recording."
    )
    baud: Annotated[int, Field(ge=9600, le=2_000_000)] = 115_200
    x_mm: Span
    y_mm: Span
    z_mm: Span
    steps_per_mm: Axes
    max_speed_mm_s: Axes
    max_acceleration_mm_s2: Axes
    acceleration_mm_s2: Positive = Field(description="While printing and travelling.")
    junction_deviation_mm: Positive = 0.013
    min_segment_time_s: NonNegative = Field(
        default=0.02, description="Below it the planner slows down when it runs empty."
    )
    min_steps_per_segment: Annotated[int, Field(ge=1, le=100)] = 6
    planner_blocks: Annotated[int, Field(ge=2, le=1024)] = 16
    command_queue: Annotated[int, Field(ge=1, le=64)] = 4
    receive_buffer_bytes: Annotated[int, Field(ge=32, le=65536)] = 128
    max_line_bytes: Annotated[int, Field(ge=32, le=512)] = 96
    emergency_parser: bool = True
    advanced_ok: bool = False
    resets_on_connect: bool = Field(
        default=True, description="Whether opening the port (DTR) resets the board."
    )
    plunger_travel_mm: Positive = Field(description="What the plunger can travel.")
    idle_timeout_s: NonNegative = Field(
        default=600,
        description="M85, set at the start of a print: the firmware's own switch-off when a "
        "killed host can't.",
    )
    safe_state_on: tuple[str, ...] = Field(
        default=(), description="What must stay on after a stop (cooling of ink and bath)."
    )
    starting_values: tuple[str, ...] = Field(
        default=(),
        description="Keys whose numbers have no source: measure them, or compare with the "
        "printer's own, before the first print.",
    )

    @model_validator(mode="after")
    def _starting_values_are_keys(self) -> Printer:
        for name in self.starting_values:
            key, _, axis = name.partition(".")
            if key not in type(self).model_fields or (axis and axis not in Axes.model_fields):
                raise ValueError(f"starting_values names {name!r}, which is no key of a printer")
        return self


class Needle(Facts):
    """A blunt needle."""

    inner_mm: Annotated[float, Field(gt=0, le=3)]
    outer_mm: Annotated[float, Field(gt=0, le=5)]
    length_mm: Annotated[float, Field(gt=0, le=200)]

    @model_validator(mode="after")
    def _has_a_wall(self) -> Needle:
        if not self.inner_mm < self.outer_mm:
            raise ValueError(f"inner {self.inner_mm:g} mm isn't below outer {self.outer_mm:g} mm")
        return self


class Syringe(Facts):
    """A syringe."""

    inner_mm: Annotated[float, Field(gt=0, le=60)]
    volume_ul: Annotated[float, Field(gt=0, le=100_000)]
    dead_volume_ul: NonNegative = 0.0


class Ink(Facts):
    """A bioink."""

    viscosity_pa_s: Positive
    density_g_cm3: Annotated[float, Field(gt=0.5, le=3)]
    temperature_c: Span = Field(description="Held while printing.")
    retract_ul: NonNegative = Field(description="Plunger relief at the end of a written path.")
    plunger_ul_s: Positive = Field(description="Flow while priming and relieving.")
    calibrated: bool = Field(description="Whether the constants were measured on a printer.")


class Bath(Facts):
    """A support bath, or the cell matrix that a network is written into."""

    yield_stress_pa: Positive
    density_g_cm3: Annotated[float, Field(gt=0.5, le=3)]
    max_printing_c: Celsius
    melt_out_c: Celsius | None = None
    floor_clearance_mm: NonNegative = Field(
        description="Kept between the needle's tip and the dish."
    )
    calibrated: bool
