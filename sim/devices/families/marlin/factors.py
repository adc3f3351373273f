"""Marlin's commands that scale speed and flow: M220, M221 factors, M200 filament diameter.

Marlin reads their percentages as 16-bit whole numbers: M220 S50.7 is 50 %, S40000 is -25536 %.
RepRapFirmware and Klipper keep the fraction.
"""

from __future__ import annotations

from dataclasses import replace

from sim.devices.board.controller import Controller
from sim.devices.board.machine import Machine
from sim.gcode.program.gcode import Command


def _whole(command: Command) -> Command:
    """With the percentage as a 16-bit whole number."""
    if "S" not in command.values:
        return command
    percent = float((int(command.values["S"]) + 0x8000 & 0xFFFF) - 0x8000)
    return replace(command, values={**command.values, "S": percent})


def m220(board: Controller, command: Command) -> None:
    """Feed factor in whole percents."""
    set_speed_percent(board, _whole(command))


def m221(board: Controller, command: Command) -> None:
    """Flow factor in whole percents."""
    set_flow_percent(board, _whole(command))


def set_speed_percent(board: Controller, command: Command) -> None:
    """Feed factor: S sets it, B keeps it aside, R takes that back; told without words."""
    machine = board.machine
    if "B" in command.words:
        machine.speed_percent_kept = float(machine.motion.modal["speed_percent"][0])
    if "R" in command.words:
        machine.motion.modal["speed_percent"] = machine.speed_percent_kept
    if "S" in command.values:
        machine.motion.modal["speed_percent"] = command.values["S"]
    if not command.words:
        machine.say(f"FR:{machine.motion.modal['speed_percent'][0]:.0f}%")


def set_flow_percent(board: Controller, command: Command) -> None:
    """Flow factor."""
    machine = board.machine
    if "S" in command.values:
        machine.motion.modal["flow_percent"] = command.values["S"]
        machine.set_flow()
    else:
        machine.say(f"echo:E0 Flow: {machine.motion.modal['flow_percent'][0]:.0f}%")


def m200(board: Controller, command: Command) -> None:
    """Filament's diameter (D, mm), and whether E counts volume (S; D alone switches it on)."""
    machine, values = board.machine, command.values
    machine.settings.filament_mm = values.get("D") or machine.settings.filament_mm
    if "D" in values:
        machine.settings.volumetric = values["D"] > 0
    if "S" in values:
        machine.settings.volumetric = values["S"] != 0
    machine.set_flow()
    if not values.keys() & set("DS"):
        machine.say(f"  {filament_line(machine)}")


def filament_line(machine: Machine) -> str:
    """M200 as it would set what is set."""
    return f"M200 S{int(machine.settings.volumetric)} D{machine.settings.filament_mm:.2f}"
