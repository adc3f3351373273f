"""Printer profile: axes, firmware, heads and limits."""

from __future__ import annotations

import re
from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, Field, field_validator, model_validator

from firmware_profiles.dispensers import Dispenser, Plunger, Pneumatic
from firmware_profiles.errors import ProfileError
from firmware_profiles.families.registry import family_names, family_of, find_family
from firmware_profiles.file_controller import (
    FileController,
    check_file_controller,
    refuse_family_sections,
)
from firmware_profiles.heads import Head, check_heads, outputs_of
from firmware_profiles.strict_model import (
    STOPS,
    CommandName,
    Facts,
    NonNegative,
    Positive,
    Span,
    StrictModel,
    SwitchCommand,
    addresses,
    fill_pressure,
    round_output,
)


def _with_a_family(name: str) -> str:
    """Refuse a firmware that no family is known of."""
    try:
        find_family(name)
    except ProfileError as exc:
        raise ValueError(str(exc)) from exc
    return name


class Axes(StrictModel):
    """One number for each axis; e is the plunger."""

    x: Positive
    y: Positive
    z: Positive
    e: Positive


_PRESSURE_ROUNDING: Final = 0.01
"""Part by which an output's whole numbers may change a pressure: flow goes with a power of it."""
_MOVE_BYTES: Final = 26
"""Of a short move, as it is sent, less the end that is withheld."""


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
        if query.split()[0].upper() in STOPS:
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


class Printer(Facts):
    """A printer: its firmware, its limits and how it counts.

    E is the plunger's travel in mm where the dispenser is one; a pneumatic head's jobs have no E,
    and the e of its axes is the firmware's own, unused.
    """

    firmware: Annotated[str, AfterValidator(_with_a_family)] = Field(
        description="Firmware family, which sets the protocol. All but Marlin are built after "
        "public sources and not verified against a real recording. For Aerotech jobs are written, "
        "and not sent.",
        json_schema_extra=lambda schema: schema.update(enum=list(family_names())),
    )
    file_controller: FileController | None = Field(
        default=None,
        description="Which controller loads the job's file; to be said for firmwares that take no "
        "lines from a host (Aerotech's), and for those alone.",
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
    min_speed_mm_s: Positive = Field(
        default=0.5,
        description="Slower moves are done at this by RepRapFirmware (M203 I, there in mm/min).",
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
        description="2: of two moves the second follows before the first is answered, where the "
        "wire or a slow adapter starves the planner; whole, or but for its end where answers come "
        "back sooner than a move takes to leave (host_turnaround_s). Only for Marlin and its fork, "
        "which count lines.",
    )
    host_turnaround_s: Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)] = Field(
        default=0.001,
        description="From an answer's last byte to the next line's first: adapter, its driver and "
        "the host. The dry run takes it, and lines_in_flight. Measured: M400 sent many times to "
        "the standing machine, the mean time to its ok, less 10 bits a byte both ways, less 0.2 ms "
        "for the board. 1 ms is a Mega's own USB chip; an FTDI chip's latency timer is 16 ms where "
        "nobody has set it.",
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
    watch: tuple[WatchedGauge, ...] = Field(
        default=(),
        description="Forces or pressures that the machine tells when asked, and their limits; "
        "asked for while it prints.",
    )
    safe_state_on: tuple[str, ...] = Field(
        default=(), description="What must stay on after a stop (cooling of ink and bath)."
    )

    @model_validator(mode="before")
    @classmethod
    def _sections_have_neutral_names(cls, data: Any) -> Any:
        if isinstance(data, dict):
            refuse_family_sections(data)
        return data

    @model_validator(mode="after")
    def _pairs_need_a_count(self) -> Printer:
        if self.lines_in_flight == 2 and not family_of(self).pairs:
            raise ValueError(
                f"lines_in_flight 2: {self.firmware} keeps no count of lines that could settle "
                "which of two it took (or none that was tried); use 1"
            )
        return self

    @property
    def streamed(self) -> bool:
        """Whether a host sends it a job's lines; else its own software loads the file."""
        return family_of(self).make_protocol is not None

    @property
    def withholds(self) -> bool:
        """Whether the second of two lines in flight leaves but for its end (`marlin.pairing`)."""
        line_s = _MOVE_BYTES * 10 / self.baud
        return self.lines_in_flight == 2 and self.host_turnaround_s < line_s

    @property
    def airs(self) -> tuple[Pneumatic, ...]:
        """Every head's valve and pressure; none where plungers push."""
        each = [head.dispenser or self.dispenser for head in self.heads] or [self.dispenser]
        return tuple(one for one in each if isinstance(one, Pneumatic))

    @property
    def pneumatic(self) -> Pneumatic | None:
        """The pneumatic head, if it is one; of several the first."""
        return next(iter(self.airs), None)

    def pressure_lines(self, number: int, kpa: float) -> list[str]:
        """Lines that set the pressure of one pneumatic head, kPa; none where a person does."""
        air = self.airs[number]
        share = kpa / air.max_pressure_kpa
        return fill_pressure(air.sets_pressure, kpa, share, family_of(self).full_output)

    def written_kpa(self, number: int, kpa: float) -> float:
        """Pressure of one pneumatic head as its line says it, which may round it, kPa."""
        air, full = self.airs[number], family_of(self).full_output
        if "{output}" not in "".join(air.sets_pressure):
            return kpa
        share = kpa / air.max_pressure_kpa
        return round_output(share, full) / full * air.max_pressure_kpa

    @property
    def pressure_pairs(self) -> dict[int, tuple[str, str]]:
        """One line each that sets a head's pressure to nothing and to its greatest, by head."""
        each = {k: air for k, air in enumerate(self.airs) if len(air.sets_pressure) == 1}
        return {
            k: (self.pressure_lines(k, 0.0)[0], self.pressure_lines(k, air.max_pressure_kpa)[0])
            for k, air in each.items()
        }

    @property
    def safe_lines(self) -> tuple[str, ...]:
        """Lines that shut every valve, then set every pressure to its resting one."""
        rests = (self.pressure_lines(k, air.resting_kpa or 0.0) for k, air in enumerate(self.airs))
        return (*(air.closes for air in self.airs), *(line for lines in rests for line in lines))

    @property
    def tool_count(self) -> int:
        """How many heads the firmware is told to choose between; valves need no choice."""
        return 1 if self.airs else self.head_count

    @property
    def z_axes(self) -> tuple[str, ...]:
        """Letters of the vertical axis of each head."""
        one = "Z" if self.file_controller is None else self.file_controller.z_axis
        return tuple(head.z_axis or one for head in self.heads) or (one,)

    @model_validator(mode="after")
    def _controller_agrees(self) -> Printer:
        asked = tuple(watched.query for watched in self.watch)
        sent = {"safe_state_off": self.safe_state_off, "watch": asked}
        check_file_controller(self.firmware, self.file_controller, self.airs, sent, self.z_axes)
        for number, air in enumerate(self.airs):
            written = self.written_kpa(number, air.pressure_kpa)
            if abs(written / air.pressure_kpa - 1.0) > _PRESSURE_ROUNDING:
                raise ValueError(
                    f"pressure_kpa {air.pressure_kpa:g} would be set as {written:.4g} kPa: "
                    f"{{output}} counts up to {family_of(self).full_output:g} for "
                    f"{air.max_pressure_kpa:g} kPa (max_pressure_kpa); write what it can say"
                )
        return self

    @model_validator(mode="after")
    def _heads_agree(self) -> Printer:
        check_heads(self.heads, self.firmware, self.dispenser)
        shut = {air.closes for air in self.airs}
        for command in self.safe_state_off:
            for one, output in outputs_of(self.heads, self.airs):
                if command not in shut and addresses(command, output):
                    raise ValueError(
                        f"safe_state_off: {command!r} sets the output of {one!r}, which a stop "
                        "leaves safe by itself; leave it out"
                    )
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
            "dispenser": head.dispenser or self.dispenser,
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
