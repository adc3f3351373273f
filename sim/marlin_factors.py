"""Factors of speed and flow that last: M200, M220 and M221 of the simulated Marlin.

Marlin reads their percentages as 16-bit whole numbers: M220 S50.7 is 50 %, S40000 is -25536 %.
RepRapFirmware and Klipper keep the fraction.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sim.gcode import Command

if TYPE_CHECKING:
    from sim.marlin_loop import MainLoop
    from sim.marlin_machine import Machine


def _percent(board: MainLoop, value: float) -> float:
    if not board.whole_percents:
        return value
    return float((int(value) + 0x8000 & 0xFFFF) - 0x8000)


def m220(board: MainLoop, command: Command) -> None:
    """Feed factor: S sets it, B keeps it aside, R takes that back; told without words."""
    machine = board.machine
    if "B" in command.words:
        machine.speed_percent_kept = float(machine.modal["speed_percent"][0])
    if "R" in command.words:
        machine.modal["speed_percent"] = machine.speed_percent_kept
    if "S" in command.values:
        machine.modal["speed_percent"] = _percent(board, command.values["S"])
    if not command.words:
        machine.say(f"FR:{machine.modal['speed_percent'][0]:.0f}%")


def m221(board: MainLoop, command: Command) -> None:
    """Flow factor."""
    machine = board.machine
    if "S" in command.values:
        machine.modal["flow_percent"] = _percent(board, command.values["S"])
        set_flow(machine)
    else:
        machine.say(f"echo:E0 Flow: {machine.modal['flow_percent'][0]:.0f}%")


def m200(board: MainLoop, command: Command) -> None:
    """Filament's diameter (D, mm), and whether E counts volume (S; D alone switches it on)."""
    machine, values = board.machine, command.values
    machine.filament_mm = values.get("D") or machine.filament_mm
    if "D" in values:
        machine.volumetric = values["D"] > 0
    if "S" in values:
        machine.volumetric = values["S"] != 0
    set_flow(machine)
    if not values.keys() & set("DS"):
        machine.say(f"  {filament_line(machine)}")


def filament_line(machine: Machine) -> str:
    """M200 as it would set what is set."""
    return f"M200 S{int(machine.volumetric)} D{machine.filament_mm:.2f}"


def set_flow(machine: Machine) -> None:
    """Give the planner what M221 and M200 make of a length of E together."""
    area_mm2 = math.pi * machine.filament_mm**2 / 4 if machine.volumetric else 1.0
    machine.planner["flow"] = float(machine.modal["flow_percent"][0]) * 0.01 / area_mm2
