"""Simulated Marlin's settings commands (M92, M200 to M206, M301) and M503 report.

A step count, speed or acceleration of 0 or less is told as it was set, as Marlin tells it, but not
kept to: what Marlin makes of it isn't modelled.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from sim.devices.board.controller import Controller
from sim.devices.board.machine import Machine
from sim.devices.families.marlin.report_commands import planned_position
from sim.gcode.program.gcode import Command

_AXES: Final = "XYZE"
_NETFABB_STEPS: Final = 20.0


def _axes(machine: Machine, field: str) -> str:
    values = [
        machine.settings.told_only.get((field, axis), float(value))
        for axis, value in enumerate(machine.motion.state[field])
    ]
    return " ".join(f"{letter}{value:.2f}" for letter, value in zip(_AXES, values, strict=True))


def line_of(machine: Machine, name: str) -> str:
    """One setting as the command that would set it, without indent."""
    state = machine.motion.state
    home = zip("XYZ", machine.settings.home_offset, strict=True)
    written, retract, travel = (float(value) for value in state["acceleration"])
    lines = {
        "M92": f"M92 {_axes(machine, 'steps_per_mm')}",
        "M200": filament_line(machine),
        "M201": f"M201 {_axes(machine, 'max_acceleration')}",
        "M203": f"M203 {_axes(machine, 'max_speed')}",
        "M204": f"M204 P{written:.2f} R{retract:.2f} T{travel:.2f}",
        "M205": f"M205 B{float(state['min_segment_us']):.2f} "
        f"S{machine.settings.least_feed:.2f} T{machine.settings.least_travel_feed:.2f} "
        f"J{float(state['junction_deviation']):.2f}",
        "M206": "M206 " + " ".join(f"{axis}{value:.2f}" for axis, value in home),
        "M301": "M301 "
        + " ".join(f"{key}{value:.2f}" for key, value in machine.settings.pid.items()),
    }
    return lines[name]


_HEADINGS: Final = {
    "M200": "Filament settings (Disabled):",
    "M92": "Steps per unit:",
    "M203": "Max feedrates (units/s):",
    "M201": "Max Acceleration (units/s2):",
    "M204": "Acceleration (units/s2) (P<print-accel> R<retract-accel> T<travel-accel>):",
    "M205": "Advanced (B<min_segment_time_us> S<min_feedrate> T<min_travel_feedrate> J<junc_dev>):",
    "M206": "Home offset:",
    "M301": "Hotend PID:",
}
"""In the order of M503. The wording of the headings comes from Marlin's documentation."""


def m503(board: Controller, command: Command) -> None:
    """All settings; S0 leaves out headings and the echo: before each line."""
    tell_settings(board.machine, command.values.get("S") == 0)


def tell_settings(machine: Machine, bare: bool = False) -> None:
    """Say all settings, each with its heading; ``bare`` without, and without echo:."""
    rows = [("Linear Units:", "G21 ; (mm)"), ("Temperature Units:", "M149 C ; Units in Celsius")]
    rows += [(heading, line_of(machine, name)) for name, heading in _HEADINGS.items()]
    if machine.board.bed_slope:
        on = bool(machine.motion.slope)
        word = "ON" if on else "OFF"
        rows.append(("Mesh Bed Leveling:", f"M420 S{on:d} Z10.00 ; Leveling {word}"))
    for heading, line in rows:
        if not bare:
            heading = (
                heading.replace(" (Disabled):", "") if machine.settings.volumetric else heading
            )
            machine.say(f"echo:; {heading}")
        machine.say(f"  {line}" if bare else f"echo:  {line}")


def _set_axes(machine: Machine, field: str, values: dict[str, float]) -> None:
    for axis, letter in enumerate(_AXES):
        if letter not in values:
            continue
        machine.settings.told_only.pop((field, axis), None)
        if values[letter] > 0:
            machine.motion.state[field][axis] = values[letter]
        else:
            machine.settings.told_only[field, axis] = values[letter]


def _change_speeds(board: Controller, command: Command) -> None:
    _set_axes(board.machine, "max_speed", command.values)


def _change_accelerations(board: Controller, command: Command) -> None:
    _set_axes(board.machine, "max_acceleration", command.values)


def _change_steps(board: Controller, command: Command) -> None:
    """Set steps/mm; where the motors stand is then counted in the new ones.

    Below 20 on E, Marlin takes it for a change of units and scales E's greatest speed with it.
    """
    machine, values = board.machine, command.values
    if 0 < values.get("E", 0.0) < _NETFABB_STEPS:
        machine.motion.state["max_speed"][3] *= (
            float(machine.motion.state["steps_per_mm"][3]) / values["E"]
        )
    _set_axes(machine, "steps_per_mm", values)
    machine.motion.count_anew()


def _change_acceleration(board: Controller, command: Command) -> None:
    field = board.machine.motion.state["acceleration"]
    values = command.values
    if "S" in values:
        field[0] = field[2] = values["S"]
    for index, letter in enumerate("PRT"):
        if letter in values:
            field[index] = values[letter]


def _change_advanced(board: Controller, command: Command) -> None:
    machine, values = board.machine, command.values
    if "B" in values:
        machine.motion.state["min_segment_us"] = values["B"]
    machine.settings.least_feed = values.get("S", machine.settings.least_feed)
    machine.settings.least_travel_feed = values.get("T", machine.settings.least_travel_feed)
    if 0.01 <= values.get("J", 0.01) <= 0.3:
        machine.motion.state["junction_deviation"] = values.get(
            "J", machine.motion.state["junction_deviation"]
        )
    else:
        machine.say("Error:?J out of range (0.01 to 0.3)")


def _change_home(board: Controller, command: Command) -> None:
    machine = board.machine
    for axis, letter in enumerate("XYZ"):
        machine.settings.home_offset[axis] = command.values.get(
            letter, machine.settings.home_offset[axis]
        )
    machine.say(planned_position(board))


def _change_pid(board: Controller, command: Command) -> None:
    pid = board.machine.settings.pid
    pid.update({key: value for key, value in command.values.items() if key in pid})


_CHANGES: Final[dict[str, tuple[str, Callable[[Controller, Command], None]]]] = {
    "M92": ("XYZE", _change_steps),
    "M201": ("XYZE", _change_accelerations),
    "M203": ("XYZE", _change_speeds),
    "M204": ("SPRT", _change_acceleration),
    "M205": ("", _change_advanced),
    "M206": ("", _change_home),
    "M301": ("PID", _change_pid),
}
"""By code: the letters of which one changes something (none: any), and the change."""


def _setting(board: Controller, command: Command) -> None:
    """Change a setting; without one of its words, tell it."""
    letters, change = _CHANGES[command.name]
    if command.words & set(letters) if letters else command.words:
        change(board, command)
    else:
        board.machine.say(f"  {line_of(board.machine, command.name)}")


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


SETTINGS_HANDLERS: Final[dict[str, Callable[[Controller, Command], None]]] = {
    **dict.fromkeys(_CHANGES, _setting),
    "M200": m200,
    "M503": m503,
}


# Marlin's commands that scale speed and flow: M220, M221 factors, M200 filament diameter.
#
# Marlin reads their percentages as 16-bit whole numbers: M220 S50.7 is 50 %, S40000 is -25536 %.
# RepRapFirmware and Klipper keep the fraction.


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


def filament_line(machine: Machine) -> str:
    """M200 as it would set what is set."""
    return f"M200 S{int(machine.settings.volumetric)} D{machine.settings.filament_mm:.2f}"
