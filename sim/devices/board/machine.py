"""State of the simulated board: clock, motors, heaters, settings."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Final, NamedTuple

import numpy as np

from firmware_profiles import Printer
from gcode.motion.state import Board, Records
from sim.devices.board.motion import Motion

# While it heats, a body of heat capacity C loses heat to the room through a resistance R and takes
# the full power P: T(t) = T_end + (T_0 - T_end) exp(-t / τ) with T_end = T_room + P R and τ = R C
# (Newton's law of cooling). At its target it is held there exactly; above it, it cools freely.
#
# Not modelled: the controller's overshoot and ripple, sensors' noise and lag, one heater warming
# another.
ROOM_C: Final = 21.0


class HeaterFacts(NamedTuple):
    """Heaters as Marlin has them."""

    unwired_c: float = -15.0  # What a thermistor input reads that nothing is connected to.
    full_duty: int = 127
    runaway_s: float = 40.0
    # THERMAL_PROTECTION_PERIOD and _HYSTERESIS as Marlin's default configuration has them
    # (Configuration_adv.h).
    runaway_c: float = 4.0
    cold_c: float = 170.0  # Below it no plunger moves, as Marlin and those after it are built.


HEATERS: Final = HeaterFacts()


@dataclass
class Heater:
    """Simulated heater.

    Attributes
    ----------
    hottest_c : float, °C
        Where it would end at full power.
    time_constant_s : float
        τ of warming and cooling.
    wired : bool
        Whether its thermistor is connected.
    powered : bool
        Whether power reaches it when it is switched on.
    """

    hottest_c: float
    time_constant_s: float
    wired: bool = True
    target_c: float = 0.0
    powered: bool = True
    _since_s: float = field(default=0.0, repr=False)
    _from_c: float = field(default=ROOM_C, repr=False)

    def set_target(self, now: float, target_c: float) -> None:
        """Heat to ``target_c`` from ``now`` on, s; 0 switches off."""
        self._from_c = self._true(now)
        self._since_s = now
        self.target_c = target_c

    def lose_power(self, now: float) -> None:
        """From ``now`` on, s, it only cools; the firmware doesn't know."""
        self._from_c = self._true(now)
        self._since_s = now
        self.powered = False

    def runs_away_at(self) -> float:
        """When thermal protection stops it, s; infinity where it has its power or is off.

        `runaway_s` after the temperature fell by `runaway_c` below a target that it had reached.
        """
        if self.powered or self.target_c <= ROOM_C:
            return math.inf
        return self.reaches_at(self.target_c - HEATERS.runaway_c) + HEATERS.runaway_s

    def read(self, now: float) -> float:
        """Temperature that the firmware sees, °C."""
        return self._true(now) if self.wired else HEATERS.unwired_c

    def duty(self, now: float) -> int:
        """Share of full power, 0 to 127, as the firmware reports it."""
        if self.target_c <= ROOM_C or not self.wired:
            return 0
        if self._true(now) < self.target_c - 0.01:
            return HEATERS.full_duty
        return round(HEATERS.full_duty * (self.target_c - ROOM_C) / (self.hottest_c - ROOM_C))

    def reaches_at(self, target_c: float) -> float:
        """When it passes ``target_c`` on its present way, s; infinity where it never does."""
        if self.wired and self._from_c == target_c:
            return self._since_s
        end = self._end()
        if not self.wired or not min(self._from_c, end) < target_c < max(self._from_c, end):
            return math.inf
        share = (target_c - end) / (self._from_c - end)
        return self._since_s - self.time_constant_s * math.log(share)

    def _end(self) -> float:
        return self.hottest_c if self.powered and self._from_c < self.target_c else ROOM_C

    def _true(self, now: float) -> float:
        end = self._end()
        decay = math.exp(-max(now - self._since_s, 0.0) / self.time_constant_s)
        free = end + (self._from_c - end) * decay
        if end == self.hottest_c:
            return min(free, self.target_c)
        return max(free, self.target_c) if self.powered and self.target_c > ROOM_C else free


class HeatFault(Enum):
    """Why a heater makes the firmware stop."""

    SENSOR = "sensor"
    RUNAWAY = "runaway"


class Heat:
    """Hotend and bed heater of a board.

    Parameters
    ----------
    thermistors : bool
        Whether they are wired.

    Attributes
    ----------
    cold_allowed : bool
        Whether the plunger may move below `coldest_c` (°C).
    awaited : bool
        Whether a command waits for a temperature.
    """

    def __init__(self, thermistors: bool) -> None:
        self.hotend = Heater(400.0, 60.0, thermistors)
        self.bed = Heater(140.0, 300.0, thermistors)
        self.cold_allowed = False
        self.coldest_c = HEATERS.cold_c
        self.awaited = False
        self._sensor_fault_at = math.inf

    def off(self, now: float) -> None:
        """Switch both off at ``now``, s."""
        self._sensor_fault_at = math.inf
        self.hotend.set_target(now, 0.0)
        self.bed.set_target(now, 0.0)

    def sensor_fails_at(self, time: float) -> None:
        """Note that a heater was switched on whose thermistor will be found to read nonsense, s."""
        self._sensor_fault_at = min(self._sensor_fault_at, time)

    def alarm(self) -> tuple[float, HeatFault]:
        """When a heater next makes the firmware stop, s (infinity: never), and why."""
        if math.isfinite(self._sensor_fault_at):
            return self._sensor_fault_at, HeatFault.SENSOR
        return self.hotend.runs_away_at(), HeatFault.RUNAWAY

    def too_cold(self, now: float) -> bool:
        """Whether the firmware refuses to move the plunger at ``now``, s."""
        return not self.cold_allowed and self.hotend.read(now) < self.coldest_c


@dataclass
class Machine:
    """Clock, motors, heaters and settings of the board.

    Attributes
    ----------
    now : float, s
        The printer's own clock; it starts at 0 with power-up and goes on through resets.
    dead : bool
        Whether the firmware is killed.
    host_pace : float
        Seconds of this clock in one of the host's.
    stored, built : StoredSettings
        What the memory holds (None: nothing yet), and what the firmware was built with.
    stuck : dict of int to str
        Endstops that are stuck, by axis; power-up mends none.
    """

    printer: Printer
    start_mm: tuple[float, float, float]
    board: Board
    byte_s: float
    now: float = 0.0
    dead: bool = False
    output: bytearray = field(default_factory=bytearray)
    host_pace: float = 1.0

    def __post_init__(self) -> None:
        self.stuck: dict[int, str] = {}
        self.stored: StoredSettings | None = None
        self.motion = Motion(self.printer, self.start_mm, self.board.costs())
        self.power_up()

    def power_up(self) -> None:
        """Forget all but the clock, the motors' true places, the log and what was stored."""
        self.motion.power_up()
        self.heat = Heat(self.board.thermistors)
        self.settings = Settings()
        self.reports = Reports()
        self.timer = JobTimer()
        self.homed = [False, False, False]
        self.soft_endstops = True
        self.idle_limit_s = 0.0
        self.idle_since = self.now
        self.stalled_until = 0.0
        self.waits_for_user = False
        self.halts_s: Callable[[], float] | None = None
        self.debug = 0
        self.speed_percent_kept = 100.0
        self.dead = False
        self.built = copy_settings(self.motion.planner, self.settings)
        if self.stored is not None:
            self.put_settings(self.stored)
            self.set_flow()

    # -- words out

    def say(self, line: str | bytes, end: bytes = b"\n") -> None:
        """Send a line; it takes its time on the wire, as there is no buffer for it."""
        data = (line.encode("latin-1") if isinstance(line, str) else line) + end
        self.output += data
        self.now += len(data) * self.byte_s

    # -- settings

    def put_settings(self, stored: StoredSettings) -> None:
        """Set all of them; the motors stay where they are."""
        for name, value in stored[0].items():
            self.motion.planner[name] = value
        self.settings = deepcopy(stored[1])
        self.motion.count_anew()

    def set_flow(self) -> None:
        """Have the planner take the flow's percentage and E's diameter as they are now."""
        self.motion.set_flow(self.settings.area_mm2)

    # -- motors, now

    def roll(self) -> None:
        """Let the motors run until now."""
        self.motion.run_until(self.now)

    def move_to(self, target_mm: Any, feed: float, line: int) -> None:
        """Put a straight move into the ring, which must have a place."""
        self.roll()
        settings = self.settings
        if settings.has_least_feeds:
            writes = self.motion.writes(target_mm)
            feed = max(feed, settings.least_feed if writes else settings.least_travel_feed)
        self.motion.add_move(target_mm, feed, line, self.now)

    # -- heat, now

    @property
    def dry(self) -> bool:
        """Whether a debug flag (M111 S8) keeps heaters and plunger off."""
        return bool(self.debug & 8)


_OF_PLANNER: Final = (
    *("steps_per_mm", "max_speed", "max_acceleration", "acceleration"),
    *("junction_deviation", "min_segment_us"),
)


@dataclass
class Settings:
    """What a firmware keeps besides the planner's own settings.

    Attributes
    ----------
    filament_mm, volumetric
        E's diameter, mm, and whether E counts volume.
    least_feed, least_travel_feed : float, mm/s
        Below which nothing moves.
    home_offset : list of float, mm
    pid : dict
        Kept and reported; the heaters' model has no controller.
    reported_only : dict
        Values by planner's field and axis that were set and are reported, but not applied.
    """

    filament_mm: float = 1.75
    volumetric: bool = False
    least_feed: float = 0.0
    least_travel_feed: float = 0.0
    home_offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    pid: dict[str, float] = field(default_factory=lambda: {"P": 22.20, "I": 1.08, "D": 114.00})
    reported_only: dict[tuple[str, int], float] = field(default_factory=dict)

    @property
    def has_least_feeds(self) -> bool:
        """Whether there is a speed below which nothing moves."""
        return self.least_feed > 0 or self.least_travel_feed > 0

    @property
    def area_mm2(self) -> float:
        """Volume of 1 mm of E in its own unit, mm²; 1 where E is a length."""
        return math.pi * self.filament_mm**2 / 4 if self.volumetric else 1.0


StoredSettings = tuple[dict[str, Any], Settings]
"""Copy of the planner's own settings, and of the others."""


def copy_settings(planner: Records, others: Settings) -> StoredSettings:
    """Copy all settings."""
    return {name: np.array(planner[name]) for name in _OF_PLANNER}, deepcopy(others)


@dataclass
class Report:
    """Interval and next time of a report, s."""

    every_s: float = 0.0
    next_at: float = math.inf

    def set(self, every_s: float, now: float) -> None:
        """Report every so often from ``now`` on; 0 or less for never."""
        self.every_s, self.next_at = every_s, now + every_s if every_s > 0 else math.inf


@dataclass
class Reports:
    """Reports by the clock, and the interval of the busy message, s."""

    temperature: Report = field(default_factory=Report)
    position: Report = field(default_factory=Report)
    keepalive_s: float = 2.0


@dataclass
class JobTimer:
    """A print timer."""

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
class Wait:
    """Something that a command waits for.

    Attributes
    ----------
    done : function
        Whether it has come.
    at : function
        When to look next, s; infinity where only the host can end it.
    for_user : bool
        Whether somebody has to do something.
    """

    done: Callable[[Machine], bool]
    at: Callable[[Machine], float]
    for_user: bool = False


Task = Iterator[Wait]
Steps = Task | None
"""What a command still has to wait for; None where it is done at once."""

FREE_SLOT: Final = Wait(
    lambda machine: machine.motion.blocks < len(machine.motion.ring) - 1,
    lambda machine: machine.motion.next_event(),
)
"""A free place in the planner's ring."""


def _ends_at(machine: Machine) -> float:
    motion = machine.motion
    return motion.next_event() if motion.blocks else motion.closed_until


STANDSTILL: Final = Wait(
    lambda machine: machine.motion.blocks == 0 and machine.now >= machine.motion.closed_until,
    _ends_at,
)
"""All motors stand and the planner takes moves."""


def wait_until(time: float) -> Wait:
    """Return the wait for a moment on the printer's clock, s."""
    return Wait(lambda machine: machine.now >= time, lambda machine: time)


def wait_for_user(until: float) -> Wait:
    """Return the wait for somebody's click, or for a moment by which none came, s."""
    return Wait(
        lambda machine: not machine.waits_for_user or machine.now >= until,
        lambda machine: until,
        for_user=True,
    )
