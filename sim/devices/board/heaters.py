"""Simulated heater with thermal mass, solved in closed form for virtual time.

While it heats, a body of heat capacity C loses heat to the room through a resistance R and takes
the full power P: T(t) = T_end + (T_0 - T_end) exp(-t / τ) with T_end = T_room + P R and τ = R C
(Newton's law of cooling). At its target it is held there exactly; above it, it cools freely.

Not modelled: the controller's overshoot and ripple, sensors' noise and lag, one heater warming
another.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

ROOM_C: Final = 21.0
UNWIRED_C: Final = -15.0
"""What a thermistor input reads that nothing is connected to."""
FULL_DUTY: Final = 127
RUNAWAY_S: Final = 40.0
RUNAWAY_C: Final = 4.0
"""THERMAL_PROTECTION_PERIOD and _HYSTERESIS as Marlin's default configuration has them
(Configuration_adv.h)."""


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

        `RUNAWAY_S` after the temperature fell by `RUNAWAY_C` below a target that it had reached.
        """
        if self.powered or self.target_c <= ROOM_C:
            return math.inf
        return self.reaches_at(self.target_c - RUNAWAY_C) + RUNAWAY_S

    def read(self, now: float) -> float:
        """Temperature that the firmware sees, °C."""
        return self._true(now) if self.wired else UNWIRED_C

    def duty(self, now: float) -> int:
        """Share of full power, 0 to 127, as the firmware reports it."""
        if self.target_c <= ROOM_C or not self.wired:
            return 0
        if self._true(now) < self.target_c - 0.01:
            return FULL_DUTY
        return round(FULL_DUTY * (self.target_c - ROOM_C) / (self.hottest_c - ROOM_C))

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


# Simulated hotend and bed heaters, with the faults that halt a firmware.

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
