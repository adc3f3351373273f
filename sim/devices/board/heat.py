"""Simulated hotend and bed heaters, with the faults that halt a firmware."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Final

from sim.devices.board.heaters import Heater

COLD_C: Final = 170.0
"""Below it no plunger moves, as Marlin and those after it are built."""


class HeatFault(Enum):
    """Why a heater makes the firmware stop."""

    SENSOR = "sensor"
    RUNAWAY = "runaway"


@dataclass(frozen=True)
class HeatAlarm:
    """When a heater makes the firmware stop, s, and why."""

    at: float = math.inf
    fault: HeatFault = HeatFault.RUNAWAY


_NO_ALARM: Final = HeatAlarm()


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
        self.coldest_c = COLD_C
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

    def alarm(self) -> HeatAlarm:
        """The next stop because of a heater."""
        if math.isfinite(self._sensor_fault_at):
            return HeatAlarm(self._sensor_fault_at, HeatFault.SENSOR)
        if self.hotend.powered:
            return _NO_ALARM
        return HeatAlarm(self.hotend.runs_away_at())

    def too_cold(self, now: float) -> bool:
        """Whether the firmware refuses to move the plunger at ``now``, s."""
        return not self.cold_allowed and self.hotend.read(now) < self.coldest_c
