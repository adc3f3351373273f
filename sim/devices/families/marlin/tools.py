"""Marlin 2.1's head change (``tool_change``), with head offsets (M218).

The motors stand first. The place gets another name, by the difference of the two heads' offsets;
where all axes are homed and S1 wasn't said, the carriage then goes so that the new tip is where the
old one was. E goes on counting where it is, and moves the new head's plunger. The reply names the
head in use, whether it is another or not. Not modelled: the small lift and the parking that a
build may do besides, on a homed machine without S1.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from sim.devices.board.controller import Controller
from sim.devices.board.machine import Machine
from sim.devices.board.waits import Task, WaitFreeSlot, WaitStandstill
from sim.gcode.program.gcode import Command
from sim.gcode.program.modal import interpret

_BACK_MM_S: Final = 300.0


def take_tool(board: Controller, command: Command) -> Task:
    """T: another head, the same again, or none such."""
    machine, number = board.machine, command.number
    count = machine.printer.head_count
    if count == 1:  # the recorded build takes any number in silence, and goes on with its one
        return
    yield WaitStandstill()
    if not 0 <= number < count:
        machine.say(f"echo:T{number} Invalid extruder")
        return
    begin = machine.motion.modal["position"][0].copy()
    shift = machine.motion.tool_offset[number] - machine.motion.tool_offset[machine.motion.tool]
    interpret(machine.motion.modal[0], board.words[0])
    machine.use_head(number)
    _rename(machine, begin[:3] + shift)
    if shift.any() and all(machine.homed) and command.values.get("S", 0.0) == 0:
        yield WaitFreeSlot()
        machine.motion.modal["position"] = begin
        machine.move_to(begin, _BACK_MM_S, -1)
        yield WaitStandstill()
    machine.say(f"echo:Active Extruder: {number}")


def _rename(machine: Machine, place_mm: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
    if (machine.motion.modal["position"][0, :3] != place_mm).any():
        for axis in range(3):
            machine.motion.stand_at(axis, float(place_mm[axis]))


def m218(board: Controller, command: Command) -> None:
    """Offset of a head's tip from the first one's (a Duet's: G10 P); without words, tell them."""
    machine = board.machine
    number = int(command.values.get("P" if command.letter == "G" else "T", machine.motion.tool))
    if not 0 <= number < machine.printer.head_count:
        machine.say(f"echo:M218 Invalid extruder {number}")
        return
    for axis, name in enumerate("XYZ"):
        if name in command.values:
            machine.motion.tool_offset[number, axis] = command.values[name]
    if not command.values:
        for one in range(1, machine.printer.head_count):
            x, y, z = machine.motion.tool_offset[one]
            machine.say(f"  M218 T{one} X{x:.2f} Y{y:.2f} Z{z:.3f}")
