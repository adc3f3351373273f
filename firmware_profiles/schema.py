"""What a profile says: facts about a machine or a material, each typed and bounded.

A profile holds facts with their source, not a user's taste.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from firmware_profiles.commands import SwitchCommand
from firmware_profiles.controllers import Aerotech, check_controller
from firmware_profiles.dispensers import Dispenser, Plunger, Pneumatic
from firmware_profiles.errors import ProfileError
from firmware_profiles.heads import Head, check_heads
from firmware_profiles.watching import Watched

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Celsius = Annotated[float, Field(ge=-80, le=300)]
Trigger = Literal["neutral_ph", "calcium", "thrombin"]
"""What makes an ink set in the bath while it is printed."""
CommandName = Annotated[str, Field(pattern=r"^([GMT]\d+|[A-Za-z]+_\w+)$")]


class Facts(BaseModel):
    """Base of all profiles: unknown keys are refused, values can't be changed."""

    model_config = ConfigDict(extra="forbid", frozen=True)

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

    E is the plunger's travel in mm where the dispenser is one; a pneumatic head's jobs have no E,
    and the e of its axes is the firmware's own, unused.
    """

    firmware: Literal[
        "marlin", "prusa", "reprapfirmware", "klipper", "smoothieware", "aerotech"
    ] = Field(
        description="Firmware family, which sets the protocol. All but marlin are built after "
        "public sources and not verified against a real recording. For aerotech jobs are written, "
        "and not sent."
    )
    aerotech: Aerotech | None = Field(
        default=None, description="Which controller; to be said for firmware aerotech alone."
    )
    baud: Annotated[int, Field(ge=9600, le=2_000_000)] = 115_200
    x_mm: Span
    y_mm: Span
    z_mm: Span
    steps_per_mm: Axes
    max_speed_mm_s: Axes
    max_acceleration_mm_s2: Axes
    acceleration_mm_s2: Positive = Field(description="While printing and travelling.")
    max_step_rate_hz: Positive | None = Field(
        default=None, description="Steps per second of one axis; an 8-bit board's if not said."
    )
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
    lines_in_flight: Literal[1, 2] = Field(
        default=1,
        description="2: moves leave in pairs, where a slow adapter starves the planner. Only for "
        "Marlin and its fork, which count lines.",
    )
    usb_ids: tuple[Annotated[str, Field(pattern="^[0-9a-f]{4}:[0-9a-f]{4}(:.+)?$")], ...] = Field(
        default=(),
        description="USB vendor:product of the board or its adapter, in hex, with :SERIAL behind "
        "where there are several alike; --port auto looks for them.",
    )
    bauds: tuple[Annotated[int, Field(ge=9600, le=2_000_000)], ...] = Field(
        default=(250_000, 115_200, 500_000, 1_000_000, 57_600),
        description="Tried by --baud auto, after `baud`.",
    )
    dtr: bool = Field(
        default=True,
        description="Whether DTR is on while the port is open. Boards with USB of their own "
        "answer only then; off keeps some boards from resetting (not on Linux, which raises it "
        "while it opens a port).",
    )
    rts: bool = Field(default=True, description="The same for RTS.")
    resets_on_connect: bool = Field(
        default=True, description="Whether opening the port (DTR) resets the board."
    )
    dispenser: Dispenser = Field(default=Plunger(), description="What pushes the ink.")
    plunger_travel_mm: Positive | None = Field(
        default=None, description="What the plunger can travel; to be said where there is one."
    )
    max_plunger_force_n: Positive | None = Field(
        default=None, description="What the head may push with; unknown without."
    )
    heads: tuple[Head, ...] = Field(
        default=(), description="Where there are several; the keys above then hold for each."
    )
    advance_s: Annotated[float, Field(ge=0, le=10, allow_inf_nan=False)] = Field(
        default=0.0,
        description="Pressure advance that the firmware's own configuration holds (Marlin's K, "
        "RepRapFirmware's M572 S, Klipper's pressure_advance); the dry run's prediction takes it.",
    )
    idle_timeout_s: NonNegative = Field(
        default=600,
        description="Set at the start of a print where the firmware can be told (M85, "
        "SET_IDLE_TIMEOUT): its own switch-off when a killed host can't; 0 for none.",
    )
    cold_extrusion_configured: bool = Field(
        default=False,
        description="Whether the firmware's own configuration lets the plunger move cold; asked "
        "for where no command does it (Klipper's min_extrude_temp).",
    )
    extra_commands: tuple[CommandName, ...] = Field(
        default=(), description="Commands that this machine knows beyond its firmware's usual ones."
    )
    safe_state_off: tuple[SwitchCommand, ...] = Field(
        default=(),
        description="Commands that switch off what else is dangerous after a stop (pressure, UV, a "
        "pump); sent when the needle has left, before the heaters go off. Nothing that moves.",
    )
    watch: tuple[Watched, ...] = Field(
        default=(),
        description="Forces or pressures that the machine tells when asked, and their limits; "
        "asked for while it prints.",
    )
    safe_state_on: tuple[str, ...] = Field(
        default=(), description="What must stay on after a stop (cooling of ink and bath)."
    )

    @model_validator(mode="after")
    def _pairs_need_a_count(self) -> Printer:
        if self.lines_in_flight == 2 and self.firmware not in ("marlin", "prusa"):
            raise ValueError(
                f"lines_in_flight 2: {self.firmware} keeps no count of lines that could settle "
                "which of two it took (or none that was tried); use 1"
            )
        return self

    @property
    def streamed(self) -> bool:
        """Whether a host sends it a job's lines; else its own software loads the file."""
        return self.firmware != "aerotech"

    @property
    def pneumatic(self) -> Pneumatic | None:
        """The pneumatic head, if it is one."""
        return self.dispenser if isinstance(self.dispenser, Pneumatic) else None

    @model_validator(mode="after")
    def _controller_agrees(self) -> Printer:
        asked = tuple(watched.query for watched in self.watch)
        sent = {"safe_state_off": self.safe_state_off, "watch": asked}
        check_controller(self.firmware, self.aerotech, self.dispenser, sent)
        return self

    @model_validator(mode="after")
    def _heads_agree(self) -> Printer:
        check_heads(self.heads, self.firmware, plunger=self.pneumatic is None)
        return self

    @property
    def head_count(self) -> int:
        """How many heads there are."""
        return max(1, len(self.heads))

    def of_head(self, number: int) -> Printer:
        """Give the printer as if it had one head alone: steps, speed, travel and force of that one.

        Raises
        ------
        ProfileError
            When there is no such head.
        """
        if not 0 <= number < self.head_count:
            raise ProfileError(
                f"{self.name} has no head {number}, only 0 to {self.head_count - 1} (heads)"
            )
        if not self.heads:
            return self
        head = self.heads[number]
        steps, speed = self.steps_per_mm, self.max_speed_mm_s
        own = {
            "name": f"{self.name}, head {number} ({head.name})",
            "heads": (),
            "steps_per_mm": steps.model_copy(update={"e": head.plunger_steps_per_mm or steps.e}),
            "max_speed_mm_s": speed.model_copy(update={"e": head.max_plunger_mm_s or speed.e}),
            "plunger_travel_mm": head.plunger_travel_mm or self.plunger_travel_mm,
            "max_plunger_force_n": head.max_plunger_force_n or self.max_plunger_force_n,
        }
        return self.model_copy(update=own)

    @model_validator(mode="after")
    def _a_plunger_s_travel_is_said(self) -> Printer:
        if (self.pneumatic is None) == (self.plunger_travel_mm is None):
            raise ValueError(
                "plunger_travel_mm must be said for a plunger, and can't be of a pneumatic head"
            )
        return self


class Needle(Facts):
    """A blunt needle, or a tapered tip."""

    inner_mm: Annotated[float, Field(gt=0, le=3)] = Field(description="Bore at the opening.")
    outer_mm: Annotated[float, Field(gt=0, le=5)] = Field(description="Of the shaft.")
    length_mm: Annotated[float, Field(gt=0, le=200)]
    hub_outer_mm: Annotated[float, Field(gt=0, le=60)] | None = Field(
        default=None,
        description="Widest of what is above the shaft and may dip below a rim: hub and syringe's "
        "end. Not measured without, and taken as 12.",
    )
    tip_outer_mm: Annotated[float, Field(gt=0, le=5)] | None = Field(
        default=None, description="Of a tapered tip: outside at the opening; with cone_mm."
    )
    cone_mm: Annotated[float, Field(gt=0, le=200)] | None = Field(
        default=None, description="Of a tapered tip: height over which it widens to outer_mm."
    )

    @model_validator(mode="after")
    def _has_a_wall(self) -> Needle:
        if (self.tip_outer_mm is None) != (self.cone_mm is None):
            raise ValueError("tip_outer_mm and cone_mm describe a tapered tip together: give both")
        if self.tip_outer_mm is not None and not self.tip_outer_mm <= self.outer_mm:
            raise ValueError(
                f"tip_outer_mm {self.tip_outer_mm:g} is above outer_mm {self.outer_mm:g}"
            )
        tip = self.tip_outer_mm or self.outer_mm
        if not self.inner_mm < tip:
            raise ValueError(f"inner {self.inner_mm:g} mm isn't below outer {tip:g} mm")
        return self


class Syringe(Facts):
    """A syringe."""

    inner_mm: Annotated[float, Field(gt=0, le=60)]
    volume_ul: Annotated[float, Field(gt=0, le=100_000)]
    dead_volume_ul: NonNegative = 0.0
    max_pressure_kpa: Positive | None = Field(
        default=None, description="What barrel and tip bear; unknown without."
    )
    friction_n: NonNegative | None = Field(
        default=None,
        description="What moves the plunger of the empty syringe; unknown without, and then not "
        "in the force.",
    )


class MeasuredLag(BaseModel):
    """How long the flow takes to follow the plunger; good for this needle and syringe alone."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    lag_s: Annotated[float, Field(gt=0, le=100, allow_inf_nan=False)] = Field(
        description="τ of τ dQ/dt = Q_in - Q."
    )
    needle: str = Field(min_length=1, description="The needle profile's `name`.")
    syringe: str = Field(min_length=1, description="The syringe profile's `name`.")


class Ink(Facts):
    """A bioink."""

    viscosity_pa_s: Positive = Field(
        description="At flow_index 1; else the consistency K of a power law, Pa s^n."
    )
    flow_index: Annotated[float, Field(gt=0.05, le=1.5)] = Field(
        default=1.0, description="n of shear stress = K (shear rate)^n; 1 is Newtonian."
    )
    yield_stress_pa: NonNegative = Field(
        default=0.0,
        description="Below it the ink stands: Herschel-Bulkley's, shear stress = this + "
        "K (shear rate)^n.",
    )
    max_shear_stress_pa: Positive | None = Field(
        default=None, description="At the needle's wall, for the cells in it; unknown without."
    )
    flow_factor: Annotated[float, Field(gt=0.2, le=5)] = Field(
        default=1.0,
        description="What comes out over what is pushed; the plunger is driven farther by it.",
    )
    lag: MeasuredLag | None = Field(
        default=None,
        description="Written by `printctl calibrate lag`; unknown without, and then the dry run "
        "predicts what lies in the bath without a lag.",
    )
    swell_factor: Annotated[float, Field(gt=0.3, le=3, allow_inf_nan=False)] | None = Field(
        default=None,
        description="Diameter of a filament that has lain in the bath over the one that was "
        "written; not measured without, and taken as 1.",
    )
    smallest_gap_mm: Positive | None = Field(
        default=None,
        description="Smallest gap between two written lines that stays open (printctl calibrate "
        "pattern comb); unknown without.",
    )
    gelled_by: tuple[Trigger, ...] = Field(
        default=(), description="What the bath must provide for the ink to set."
    )
    density_g_cm3: Annotated[float, Field(gt=0.5, le=3)]
    temperature_c: Span = Field(description="Held while printing.")
    write_speed_mm_s: Span | None = Field(
        default=None,
        description="Speeds at which a written line holds together; unknown without.",
    )
    retract_ul: NonNegative = Field(description="Plunger relief at the end of a written path.")
    plunger_ul_s: Positive = Field(description="Flow while priming and relieving.")
    dwell_s: Annotated[float, Field(ge=0, le=60, allow_inf_nan=False)] = Field(
        default=0.0,
        description="Pause after a prime, until the ink flows, where vessels or a prime line are "
        "written.",
    )
    viability_min: Positive | None = Field(
        default=None,
        description="How long the ink may take from the syringe's filling to the print's end for "
        "its cells' sake; unknown without.",
    )
    viability_source: str | None = Field(
        default=None, min_length=1, description="Where viability_min comes from."
    )
    calibrated: bool = Field(description="Whether the constants were measured on a printer.")

    @model_validator(mode="after")
    def _a_viability_budget_has_a_source(self) -> Ink:
        if (self.viability_min is None) != (self.viability_source is None):
            raise ValueError(
                "viability_min and viability_source go together: say how long, and where that "
                "comes from (a paper, your own live/dead counts)"
            )
        return self


class Bath(Facts):
    """A support bath, or the cell matrix that a network is written into."""

    yield_stress_pa: Positive
    viscosity_pa_s: Positive | None = Field(
        default=None,
        description="Plastic viscosity above the yield stress (Bingham's); says how fast a "
        "filament sinks that isn't held. Unknown without.",
    )
    recovery_s: Positive | None = Field(
        default=None,
        description="How long the bath takes to close behind the needle; unknown without.",
    )
    density_g_cm3: Annotated[float, Field(gt=0.5, le=3)]
    max_printing_c: Celsius
    melt_out_c: Celsius | None = None
    floor_clearance_mm: NonNegative = Field(
        description="Kept between the needle's tip and the dish."
    )
    provides: tuple[Trigger, ...] = Field(
        default=(), description="What sets an ink in it (buffer, calcium, thrombin)."
    )
    calibrated: bool


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
