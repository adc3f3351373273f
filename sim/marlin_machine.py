"""The simulated board's state: clock, motors, heaters, settings. No bytes come in here."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

import numpy as np

from firmware_profiles import Printer, Span
from firmware_profiles.families import family_of
from sim.executed import ExecutedMotion
from sim.executed_log import executed_motion
from sim.gcode_modal import new_modal
from sim.heaters import Heater
from sim.marlin_board import Board
from sim.marlin_factors import set_flow
from sim.marlin_halt import RunOn
from sim.marlin_stored import Settings, put_settings, settings_of
from sim.planner import (
    add_move,
    command_time,
    counted,
    next_event,
    run_until,
    set_axis,
    stop_now,
    take_head,
)
from sim.planner_block import to_steps
from sim.planner_state import LOG, new_planner, new_ring

COLD_C: Final = 170.0
QUICKSTOP_S: Final = 1.024
"""For so long after a quickstop the planner takes no moves: 1000 ticks at 976.6 Hz."""
_FIRST_LOG: Final = 4096


class Wait(Protocol):
    """Something that a command waits for while the board goes on reading and reporting."""

    @property
    def busy(self) -> str:
        """What the board says it is doing."""

    def done(self, machine: Machine) -> bool:
        """Whether it has come."""

    def at(self, machine: Machine) -> float:
        """When to look next, s; infinity where only the host can end it."""


Task = Iterator[Wait]


@dataclass(frozen=True)
class Until:
    """A moment on the printer's clock."""

    time: float
    busy: str = "processing"

    def done(self, machine: Machine) -> bool:
        """Whether it has passed."""
        return machine.now >= self.time

    def at(self, machine: Machine) -> float:
        """The moment."""
        return self.time


@dataclass(frozen=True)
class Place:
    """A free place in the planner's ring."""

    busy: str = "processing"

    def done(self, machine: Machine) -> bool:
        """Whether there is one."""
        return machine.blocks < len(machine.ring) - 1

    def at(self, machine: Machine) -> float:
        """When a block ends."""
        return machine.next_motion()


@dataclass(frozen=True)
class Still:
    """All motors stand and the planner takes moves."""

    busy: str = "processing"

    def done(self, machine: Machine) -> bool:
        """Whether they do."""
        return machine.blocks == 0 and machine.now >= machine.closed_until

    def at(self, machine: Machine) -> float:
        """When a block ends, or the pause after a quickstop."""
        return machine.next_motion() if machine.blocks else machine.closed_until


@dataclass
class User:
    """Somebody's click, or a moment by which none came."""

    until: float
    busy: str = "paused for user"

    def done(self, machine: Machine) -> bool:
        """Whether the user has answered."""
        return not machine.waits_for_user or machine.now >= self.until

    def at(self, machine: Machine) -> float:
        """When it gives up."""
        return self.until


@dataclass
class Reports:
    """What the firmware says without being asked: interval and next time of each, s."""

    temperature_s: float = 0.0
    temperature_at: float = np.inf
    position_s: float = 0.0
    position_at: float = np.inf
    keepalive_s: float = 2.0


@dataclass
class JobTimer:
    """Marlin's print timer (M75 to M77)."""

    started_at: float | None = None
    gathered_s: float = 0.0

    def start(self, now: float) -> None:
        """Start, afresh where it was stopped."""
        if self.started_at is None:
            self.started_at = now

    def stop(self, now: float) -> None:
        """Stop and keep what was gathered."""
        self.gathered_s = self.read(now)
        self.started_at = None

    def read(self, now: float) -> float:
        """Seconds gathered."""
        running = 0.0 if self.started_at is None else now - self.started_at
        return self.gathered_s + running


@dataclass(frozen=True)
class HeatAlarm:
    """When a heater makes the firmware stop, s, and what it says then."""

    at: float = math.inf
    error: str = ""
    reason: str = ""


_NO_ALARM: Final = HeatAlarm()


@dataclass
class Machine:
    """Clock, motors, heaters and settings of the board.

    Attributes
    ----------
    now : float, s
        The printer's own clock; it starts at 0 with power-up and goes on through resets.
    modal, planner, ring, log : records
        See `sim.gcode_modal` and `sim.planner_state`.
    """

    printer: Printer
    start_mm: tuple[float, float, float]
    board: Board
    byte_s: float
    now: float = 0.0
    dead: bool = False
    output: bytearray = field(default_factory=bytearray)

    def __post_init__(self) -> None:
        self.stuck: dict[int, str] = {}  # endstops, by axis; power-up mends none
        self.stored: Settings | None = None  # the EEPROM
        self.ring = new_ring(self.printer)
        self.log = np.zeros(_FIRST_LOG, LOG)
        self.costs = self.board.costs()
        self._steps = np.zeros(4, np.int64)
        self.planner = new_planner(self.printer, self.start_mm)
        self.power_up()

    def power_up(self) -> None:
        """Forget all but the clock, the motors' true places and the log."""
        printer = self.printer
        fresh = new_planner(printer, self.start_mm)
        for name in ("physical", "plungers", "first_pulse", "logged", "merged", "run_end"):
            fresh[name] = self.planner[name]
        fresh["plungers"][0, self.tool] = self.planner["physical"][0, 3]
        fresh["physical"][0, 3] = fresh["plungers"][0, 0]
        fresh["shift"] = fresh["physical"] - fresh["position"]
        self.planner[:] = fresh
        rule = family_of(printer).grammar.e_rule
        self.modal = new_modal(self.start_mm, printer.head_count, rule)
        self.tool_offset = np.zeros((printer.head_count, 3))
        spans: tuple[Span, ...] = (printer.x_mm, printer.y_mm, printer.z_mm)
        self.modal["low"] = [span.low for span in spans]
        self.modal["high"] = [span.high for span in spans]
        self.hotend = Heater(400.0, 60.0, self.board.thermistors)
        self.bed = Heater(140.0, 300.0, self.board.thermistors)
        self.homed = [False, False, False]
        self.soft_endstops = True
        self.cold_allowed = False
        self.coldest_c = COLD_C
        self.reports = Reports()
        self.timer = JobTimer()
        self.idle_limit_s = 0.0
        self.idle_since = self.now
        self.closed_until = 0.0
        self.stalled_until = 0.0
        self.waits_for_user = False
        self.waits_for_heat = False
        self.sensor_fault_at = math.inf
        self.run_on: RunOn | None = None
        self.debug = 0
        self.speed_percent_kept = 100.0
        self.filament_mm = 1.75
        self.volumetric = False
        self.least_feed = self.least_travel_feed = 0.0
        self.told_only: dict[tuple[str, int], float] = {}
        self.home_offset = [0.0, 0.0, 0.0]
        # Kept and told; the heaters' model has no controller.
        self.pid = {"P": 22.20, "I": 1.08, "D": 114.00}
        self.dead = False
        self.built = settings_of(self)
        if self.stored is not None:
            put_settings(self, self.stored)
            set_flow(self)

    # -- words out

    def say(self, line: str | bytes, end: bytes = b"\n") -> None:
        """Send a line; it takes its time on the wire, as there is no buffer for it."""
        data = (line.encode("latin-1") if isinstance(line, str) else line) + end
        self.output += data
        self.now += len(data) * self.byte_s

    # -- motors

    @property
    def state(self) -> Any:
        """The planner's record."""
        return self.planner[0]

    @property
    def blocks(self) -> int:
        """Blocks in the ring, the running one too."""
        return int(self.planner["count"][0])

    def roll(self) -> None:
        """Let the motors run until now."""
        self.make_room()
        run_until(self.planner, self.ring, self.log, self.now)

    def make_room(self) -> None:
        """Lengthen the log where it might not hold all blocks of the ring."""
        if int(self.planner["logged"][0]) + 2 * len(self.ring) > len(self.log):
            self.log = np.concatenate([self.log, np.zeros_like(self.log)])

    def next_motion(self) -> float:
        """When the stepper next ends or takes a block, s."""
        return float(next_event(self.planner))

    def command_s(self) -> float:
        """Processor's time for a command now, s."""
        return float(command_time(self.planner, self.ring, self.now, self.costs))

    def move_to(self, target_mm: Any, feed: float, line: int) -> None:
        """Put a straight move into the ring, which must have a place."""
        self.roll()
        if self.has_least_feeds:
            end = to_steps(target_mm[3], self.state["steps_per_mm"][3])
            writes = end != self.state["position"][3]
            feed = max(feed, self.least_feed if writes else self.least_travel_feed)
        if self.now >= self.closed_until:
            add_move(self.planner, self.ring, target_mm, feed, line, self.now)

    def steps_now(self) -> list[int]:
        """Stepper counts at this moment, as the firmware numbers them."""
        self.roll()
        counted(self.planner, self.ring, self.now, self._steps)
        return [int(v) for v in self._steps - self.planner["shift"][0]]

    def events_of_running(self) -> int:
        """Step events done of the block that runs now."""
        return int(counted(self.planner, self.ring, self.now, self._steps))

    def stop(self) -> None:
        """Drop all moves; the firmware's position becomes where the motors stand."""
        self.make_room()
        stop_now(self.planner, self.ring, self.log, self.now)
        native = self.planner["position"][0] / self.planner["steps_per_mm"][0].astype(float)
        self.modal["plunger_shift"] += self.modal["position"][0, 3] - native[3]
        self.modal["position"] = native

    def stand_at(self, axis: int, position_mm: float) -> None:
        """Call where an axis stands ``position_mm``, as homing does that finds its switch."""
        set_axis(self.planner, axis, position_mm)
        self.modal["position"][0, axis] = position_mm

    @property
    def has_least_feeds(self) -> bool:
        """Whether M205 has set a speed below which nothing moves."""
        return self.least_feed > 0 or self.least_travel_feed > 0

    def count_anew(self) -> None:
        """Count where the last block ends in the steps/mm as they are now; no motor moves."""
        state = self.state
        state["mm_per_step"] = np.float32(1) / state["steps_per_mm"]
        for axis in range(4):
            set_axis(self.planner, axis, float(self.modal["position"][0, axis]))

    def set_plunger(self, position_mm: float) -> None:
        """Call the plunger's planned position ``position_mm``."""
        set_axis(self.planner, 3, position_mm)

    @property
    def tool(self) -> int:
        """The head that E moves."""
        return int(self.planner["tool"][0])

    def use_head(self, number: int) -> None:
        """Have E move that head's plunger from now on; the motors stand."""
        self.roll()
        take_head(self.planner, number, float(self.modal["position"][0, 3]))

    def executed(self) -> ExecutedMotion:
        """Blocks that ran up to now."""
        self.roll()
        return executed_motion(self.log[: int(self.planner["logged"][0])], self.printer)

    # -- heat

    def heaters_off(self) -> None:
        """Switch both heaters off."""
        self.sensor_fault_at = math.inf
        self.hotend.set_target(self.now, 0.0)
        self.bed.set_target(self.now, 0.0)

    def sensor_fails_at(self, time: float) -> None:
        """A heater was switched on whose thermistor reads nonsense."""
        self.sensor_fault_at = min(self.sensor_fault_at, time)

    def heat_alarm(self) -> HeatAlarm:
        """The next stop because of a heater."""
        if math.isfinite(self.sensor_fault_at):
            return HeatAlarm(self.sensor_fault_at, "MINTEMP triggered", "Err: MINTEMP")
        if self.hotend.powered:
            return _NO_ALARM
        return HeatAlarm(self.hotend.runs_away_at(), "Thermal Runaway", "THERMAL RUNAWAY")

    @property
    def dry(self) -> bool:
        """Whether M111 S8 keeps heaters and plunger off."""
        return bool(self.debug & 8)

    @property
    def too_cold(self) -> bool:
        """Whether the firmware refuses to move the plunger."""
        return not self.cold_allowed and self.hotend.read(self.now) < self.coldest_c

    def temperatures(self) -> str:
        """Report as in M105, from the blank on."""
        now = self.now
        return (
            f" T:{self.hotend.read(now):.2f} /{self.hotend.target_c:.2f}"
            f" B:{self.bed.read(now):.2f} /{self.bed.target_c:.2f}"
            f" @:{self.hotend.duty(now)} B@:{self.bed.duty(now)}"
        )
