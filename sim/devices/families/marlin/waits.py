"""Marlin's commands that wait: G4, G28, M0, M81, M109, M400, M420, M500; also M104, M410.

A function is a generator that yields what it waits for, or does its work at once.
"""

from __future__ import annotations

import math
import re
from typing import Final

from sim.devices.board.controller import Controller
from sim.devices.board.waits import Steps, Task, User, WaitStandstill, WaitUntil
from sim.devices.families.marlin.report_commands import planned_position, temperatures
from sim.devices.families.marlin.texts import SETTINGS
from sim.devices.families.marlin.urgent import quickstop
from sim.gcode.program.gcode import Command
from sim.gcode.program.modal import dwell_s

_HOMING_MM_S: Final = 50.0
_HOMING_Z_MM_S: Final = 4.0
_RESIDENCE_S: Final = 10.0
_WINDOW_C: Final = 1.0
_LOOK_S: Final = 0.25
_POWER_OFF_S: Final = 1.0
_TEXT: Final = re.compile(rb"M *\d+ *(?:[A-Z] *[-+]?\d+\.?\d* *)*(.*)")
"""Behind a code and words with a number."""
_SENSOR_FAULT_S: Final = 0.034


def g4(board: Controller, command: Command) -> Task:
    """Dwell: the motors stand first."""
    seconds = float(dwell_s(board.words[0]))
    yield WaitStandstill()
    yield WaitUntil(board.machine.now + seconds)


def g28(board: Controller, command: Command) -> Task:
    """Home: a straight run to the low end of each axis; no probing, no second touch.

    A switch stuck closed is found at once, wherever the carriage stands. One stuck open isn't
    found: the axis runs against its end for half its length more, then the firmware stops.
    """
    machine = board.machine
    named = [axis for axis, name in enumerate("XYZ") if name in {*command.values, *command.flags}]
    lows = machine.motion.modal["low"][0].copy()
    for axis in named or (2, 0, 1):
        yield WaitStandstill()
        if machine.stuck.get(axis) == "closed":
            machine.motion.stand_at(axis, float(lows[axis]))
        speed = _HOMING_Z_MM_S if axis == 2 else _HOMING_MM_S
        target = machine.motion.modal["position"][0].copy()
        target[axis] = lows[axis]
        machine.motion.modal["position"] = target
        machine.move_to(target, speed, -1)
        yield WaitStandstill()
        if machine.stuck.get(axis) == "open":
            length = float(machine.motion.modal["high"][0, axis] - lows[axis])
            yield WaitUntil(machine.now + length / 2 / speed)
            board.kill("Homing Failed")
            return
        machine.homed[axis] = True
        machine.motion.modal["shift"][0, axis] = 0.0
    limit_homed(board)
    if machine.board.levels_after_homing:
        machine.motion.level(machine.board.bed_slope)
    machine.say(planned_position(board))


def m420(board: Controller, command: Command) -> Task:
    """Switch bed levelling on or off, with the motors at rest; tell which."""
    motion = board.machine.motion
    yield WaitStandstill()
    if "S" in command.values:
        motion.level(board.machine.board.bed_slope if command.values["S"] else 0.0)
    board.machine.say(f"echo:Bed Leveling {'ON' if motion.slope else 'OFF'}")


def limit_homed(board: Controller) -> None:
    """Let the software endstops hold on the axes that were homed, while M211 is on."""
    machine = board.machine
    machine.motion.modal["limited"] = [homed and machine.soft_endstops for homed in machine.homed]


def m0(board: Controller, command: Command) -> Task:
    """Wait for the user: M108, or the time of S or P."""
    machine = board.machine
    match = _TEXT.fullmatch(command.text.strip())
    message = match[1].decode("latin-1") if match else ""
    seconds = command.values.get("S", command.values.get("P", 0.0) * 1e-3)
    yield WaitStandstill()
    if message:
        machine.say(f"echo:{message}", b"\r\n")
    machine.say("//action:prompt_end")
    stop = "M0 Stop" if command.number == 0 else "M1 Stop"
    machine.say(f"//action:prompt_begin {message or stop}")
    machine.say("//action:prompt_button Continue")
    machine.say("//action:prompt_show")
    machine.waits_for_user = True
    yield User(machine.now + seconds if seconds > 0 else math.inf)
    machine.waits_for_user = False


def m104(board: Controller, command: Command) -> None:
    """Target of the hotend, or (M140) of the bed."""
    heater = board.machine.heat.hotend if command.number in (104, 109) else board.machine.heat.bed
    target = command.values.get("S", command.values.get("R"))
    if target is not None and not board.machine.dry:
        heater.set_target(board.machine.now, target)
        if not heater.wired and target > 0:
            board.machine.heat.sensor_fails_at(board.machine.now + _SENSOR_FAULT_S)


def m109(board: Controller, command: Command) -> Task:
    """Wait for the hotend, or (M190) the bed: S while it heats, R while it cools as well."""
    machine = board.machine
    m104(board, command)
    heater = machine.heat.hotend if command.number == 109 else machine.heat.bed
    target = heater.target_c
    if "R" not in command.values and heater.read(machine.now) > target:
        return
    machine.heat.awaited = True
    report_at = machine.now
    there_at: float | None = None
    while machine.heat.awaited:
        near = abs(heater.read(machine.now) - target) < _WINDOW_C
        if near and there_at is None:
            there_at = machine.now
        left = math.inf if there_at is None else there_at + _RESIDENCE_S - machine.now
        if machine.now >= report_at:
            rest = "?" if math.isinf(left) else str(max(int(left), 0))
            machine.say(f"{temperatures(machine)} W:{rest}")
            report_at += 1.0
        if left <= 0:
            break
        yield WaitUntil(min(report_at, machine.now + min(_LOOK_S, max(left, 1e-3))))
    machine.heat.awaited = False


def m81(board: Controller, command: Command) -> Task:
    """Power off: heaters off, the motors end; the supply itself isn't the board's to switch."""
    board.machine.heaters_off()
    yield WaitStandstill()
    yield WaitUntil(board.machine.now + _POWER_OFF_S)


def m400(board: Controller, command: Command) -> Task:
    """Wait until the motors stand."""
    yield WaitStandstill()


def m410(board: Controller, command: Command) -> Steps:
    """Quickstop; with the emergency parser it has happened already when the line is read."""
    return None if board.machine.printer.emergency_parser else quickstop(board)


def m500(board: Controller, command: Command) -> Task:
    """Store the settings; the processor waits for the EEPROM."""
    board.machine.store_settings()
    board.machine.stalled_until = board.machine.now + board.machine.board.store_s
    board.hold_busy()
    yield WaitUntil(board.machine.stalled_until)
    board.machine.say(f"echo:Settings Stored ({SETTINGS})")
    board.machine.say("//action:notification Settings Stored")
