"""State of the simulated board: clock, motors, heaters, settings."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

from firmware_profiles import Printer
from sim.devices.board.heat import Heat
from sim.devices.board.motion import Motion
from sim.devices.board.reports import JobTimer, Reports
from sim.devices.board.settings import Settings, StoredSettings
from sim.gcode.motion.executed import ExecutedMotion
from sim.gcode.motion.hardware import Board


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
