"""State of the simulated board: clock, motors, heaters, settings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

import numpy as np

from firmware_profiles import Printer
from sim.devices.board.heaters import Heat
from sim.devices.board.motion import Motion
from sim.gcode.motion.executed import ExecutedMotion
from sim.gcode.motion.hardware import Board
from sim.gcode.motion.state import Records


class MotorRunOn(Protocol):
    """Time between a firmware's last words and the halt of its motors."""

    def ends_s(self) -> float:
        """When the motors stop, s, by what is known now; later events put it off."""


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
    motion : Motion
    heat : Heat
    settings : Settings
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
        self.run_on: MotorRunOn | None = None
        self.debug = 0
        self.speed_percent_kept = 100.0
        self.dead = False
        self.built = StoredSettings.of(self.motion.planner, self.settings)
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

    def store_settings(self) -> None:
        """Store all settings as they are."""
        self.stored = StoredSettings.of(self.motion.planner, self.settings)

    def put_settings(self, stored: StoredSettings) -> None:
        """Set all of them; the motors stay where they are."""
        self.settings = stored.put(self.motion.planner)
        self.motion.count_anew()

    def set_flow(self) -> None:
        """Have the planner take the flow's percentage and E's diameter as they are now."""
        self.motion.set_flow(self.settings.area_mm2)

    # -- motors, now

    def roll(self) -> None:
        """Let the motors run until now."""
        self.motion.run_until(self.now)

    def command_s(self) -> float:
        """Processor's time for a command now, s."""
        return self.motion.command_s(self.now)

    def move_to(self, target_mm: Any, feed: float, line: int) -> None:
        """Put a straight move into the ring, which must have a place."""
        self.roll()
        settings = self.settings
        if settings.has_least_feeds:
            writes = self.motion.writes(target_mm)
            feed = max(feed, settings.least_feed if writes else settings.least_travel_feed)
        self.motion.add_move(target_mm, feed, line, self.now)

    def steps_now(self) -> list[int]:
        """Stepper counts at this moment, as the firmware numbers them."""
        return self.motion.steps_at(self.now)

    def stop(self) -> None:
        """Drop all moves; the firmware's position becomes where the motors stand."""
        self.motion.stop(self.now)

    def use_head(self, number: int) -> None:
        """Have E move that head's plunger from now on; the motors stand."""
        self.motion.use_head(number, self.now)

    def executed(self) -> ExecutedMotion:
        """Blocks that ran up to now."""
        return self.motion.executed(self.now)

    # -- heat, now

    def heaters_off(self) -> None:
        """Switch both heaters off."""
        self.heat.off(self.now)

    @property
    def too_cold(self) -> bool:
        """Whether the firmware refuses to move the plunger."""
        return self.heat.too_cold(self.now)

    @property
    def dry(self) -> bool:
        """Whether a debug flag (M111 S8) keeps heaters and plunger off."""
        return bool(self.debug & 8)


# Settings of the simulated board, and their EEPROM storage.

_OF_PLANNER: Final = (
    *("steps_per_mm", "max_speed", "max_acceleration", "acceleration"),
    *("junction_deviation", "min_segment_us"),
)


def _pid() -> dict[str, float]:
    return {"P": 22.20, "I": 1.08, "D": 114.00}


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
        Kept and told; the heaters' model has no controller.
    told_only : dict
        Values by planner's field and axis that were set and are told, but not kept to.
    """

    filament_mm: float = 1.75
    volumetric: bool = False
    least_feed: float = 0.0
    least_travel_feed: float = 0.0
    home_offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    pid: dict[str, float] = field(default_factory=_pid)
    told_only: dict[tuple[str, int], float] = field(default_factory=dict)

    @property
    def has_least_feeds(self) -> bool:
        """Whether there is a speed below which nothing moves."""
        return self.least_feed > 0 or self.least_travel_feed > 0

    @property
    def area_mm2(self) -> float:
        """Volume of 1 mm of E in its own unit, mm²; 1 where E is a length."""
        return math.pi * self.filament_mm**2 / 4 if self.volumetric else 1.0


@dataclass(frozen=True)
class StoredSettings:
    """Copy of all settings, the planner's own too."""

    planner: Mapping[str, Any]
    others: Settings

    @staticmethod
    def of(planner: Records, others: Settings) -> StoredSettings:
        """Copy them."""
        return StoredSettings(
            {name: np.array(planner[name]) for name in _OF_PLANNER}, deepcopy(others)
        )

    def put(self, planner: Records) -> Settings:
        """Set the planner's own; return the others."""
        for name, value in self.planner.items():
            planner[name] = value
        return deepcopy(self.others)


# Unsolicited reports of a simulated firmware (temperature, position), and its print timer.


@dataclass
class Reports:
    """Interval and next time of each report, s."""

    temperature_s: float = 0.0
    temperature_at: float = np.inf
    position_s: float = 0.0
    position_at: float = np.inf
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
