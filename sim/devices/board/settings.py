"""Settings of the simulated board, and their EEPROM storage."""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from sim.gcode.motion.state import Records

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
