"""The EEPROM of the simulated Marlin: settings that M500 stores and a reset brings back."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from sim.marlin_machine import Machine

_OF_PLANNER: Final = (
    *("steps_per_mm", "max_speed", "max_acceleration", "acceleration"),
    *("junction_deviation", "min_segment_us"),
)
_OF_MACHINE: Final = (
    *("filament_mm", "volumetric", "least_feed", "least_travel_feed"),
    *("home_offset", "pid", "told_only"),
)
Settings = Mapping[str, Any]


def settings_of(machine: Machine) -> Settings:
    """Copy all settings that the EEPROM has a place for."""
    planner = {name: np.array(machine.planner[name]) for name in _OF_PLANNER}
    return planner | {name: deepcopy(getattr(machine, name)) for name in _OF_MACHINE}


def put_settings(machine: Machine, settings: Settings) -> None:
    """Set all of them; the motors stay where they are."""
    for name in _OF_PLANNER:
        machine.planner[name] = settings[name]
    for name in _OF_MACHINE:
        setattr(machine, name, deepcopy(settings[name]))
    machine.count_anew()


def store_settings(machine: Machine) -> None:
    """M500."""
    machine.stored = settings_of(machine)


def load_settings(machine: Machine) -> None:
    """M501: what was stored last, as it was built where nothing was."""
    put_settings(machine, machine.stored or machine.built)


def reset_settings(machine: Machine) -> None:
    """M502."""
    put_settings(machine, machine.built)
