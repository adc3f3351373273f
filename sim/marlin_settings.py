"""Settings of the firmware: M92, M201 to M206, M200, M301, and all of them in M503."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sim.gcode import Command

if TYPE_CHECKING:
    from sim.marlin_loop import MainLoop
    from sim.marlin_machine import Machine

_AXES: Final = "XYZE"


def _four(letter_values: Any) -> str:
    pairs = zip(_AXES, letter_values, strict=True)
    return " ".join(f"{axis}{float(value):.2f}" for axis, value in pairs)


def line_of(machine: Machine, name: str) -> str:
    """One setting as the command that would set it, without indent."""
    state = machine.state
    kept = machine.filament_mm
    home = zip("XYZ", machine.home_offset, strict=True)
    written, retract, travel = (float(value) for value in state["acceleration"])
    lines = {
        "M92": f"M92 {_four(state['steps_per_mm'])}",
        "M200": f"M200 S0 D{kept:.2f}",
        "M201": f"M201 {_four(state['max_acceleration'])}",
        "M203": f"M203 {_four(state['max_speed'])}",
        "M204": f"M204 P{written:.2f} R{retract:.2f} T{travel:.2f}",
        "M205": f"M205 B{float(state['min_segment_us']):.2f} S0.00 T0.00 "
        f"J{float(state['junction_deviation']):.2f}",
        "M206": "M206 " + " ".join(f"{axis}{value:.2f}" for axis, value in home),
        "M301": "M301 " + " ".join(f"{key}{value:.2f}" for key, value in machine.pid.items()),
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


def m503(board: MainLoop, command: Command) -> None:
    """All settings; S0 leaves out headings and the echo: before each line."""
    bare = command.values.get("S") == 0
    rows = [("Linear Units:", "G21 ; (mm)"), ("Temperature Units:", "M149 C ; Units in Celsius")]
    rows += [(heading, line_of(board.machine, name)) for name, heading in _HEADINGS.items()]
    for heading, line in rows:
        if not bare:
            board.machine.say(f"echo:; {heading}")
        board.machine.say(f"  {line}" if bare else f"echo:  {line}")


def _change_axes(field: str) -> Callable[[MainLoop, Command], bool]:
    def change(board: MainLoop, command: Command) -> bool:
        found = False
        for axis, letter in enumerate(_AXES):
            if command.values.get(letter, 0.0) > 0:
                board.machine.state[field][axis] = command.values[letter]
                found = True
        return found

    return change


def _change_steps(board: MainLoop, command: Command) -> bool:
    changed = _change_axes("steps_per_mm")(board, command)
    if changed:
        state = board.machine.state
        state["mm_per_step"] = np.float32(1) / state["steps_per_mm"]
    return changed


def _change_acceleration(board: MainLoop, command: Command) -> bool:
    field = board.machine.state["acceleration"]
    values = command.values
    if "S" in values:
        field[0] = field[2] = values["S"]
    for index, letter in enumerate("PRT"):
        if letter in values:
            field[index] = values[letter]
    return bool(values.keys() & set("SPRT"))


def _change_advanced(board: MainLoop, command: Command) -> bool:
    state, values = board.machine.state, command.values
    if "B" in values:
        state["min_segment_us"] = values["B"]
    if 0.01 <= values.get("J", 0.0) <= 0.3:
        state["junction_deviation"] = values["J"]
    return bool(values)


def _change_home(board: MainLoop, command: Command) -> bool:
    for axis, letter in enumerate("XYZ"):
        board.machine.home_offset[axis] = command.values.get(
            letter, board.machine.home_offset[axis]
        )
    return bool(command.values)


def _change_filament(board: MainLoop, command: Command) -> bool:
    board.machine.filament_mm = command.values.get("D", board.machine.filament_mm)
    return bool(command.values)


def _change_pid(board: MainLoop, command: Command) -> bool:
    pid = board.machine.pid
    pid.update({key: value for key, value in command.values.items() if key in pid})
    return bool(command.values)


_CHANGES: Final[dict[str, Callable[[MainLoop, Command], bool]]] = {
    "M92": _change_steps,
    "M200": _change_filament,
    "M201": _change_axes("max_acceleration"),
    "M203": _change_axes("max_speed"),
    "M204": _change_acceleration,
    "M205": _change_advanced,
    "M206": _change_home,
    "M301": _change_pid,
}


def _setting(board: MainLoop, command: Command) -> None:
    """Change a setting; without values, tell it."""
    if not _CHANGES[command.name](board, command):
        board.machine.say(f"  {line_of(board.machine, command.name)}")


SETTINGS_HANDLERS: Final[dict[str, Callable[[MainLoop, Command], None]]] = {
    **dict.fromkeys(_CHANGES, _setting),
    "M503": m503,
}
