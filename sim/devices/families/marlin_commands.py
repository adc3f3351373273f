"""Table of Marlin's command handlers by code, and the small ones themselves (M75, M85, M302…).

Wordings and line ends are those of the recorded build (`tests/sim/data/marlin`).
"""

from __future__ import annotations

import math
import re
from typing import Final, NamedTuple

from gcode.program.gcode import Command
from gcode.program.modal import dwell_s, interpret
from sim.devices.board.controller import Controller, Handlers
from sim.devices.board.machine import (
    STANDSTILL,
    Steps,
    Task,
    copy_settings,
    wait_for_user,
    wait_until,
)
from sim.devices.board.printer import set_position
from sim.devices.families.marlin_reports import (
    REPLIES,
    SETTINGS,
    planned_position,
    quickstop,
    request_resend,
    tell_settings,
    temperatures,
)


def g92(board: Controller, command: Command) -> None:
    """Give the position other numbers, then report where the motors are."""
    set_position(board)
    board.machine.say(planned_position(board))


def m211(board: Controller, command: Command) -> None:
    """Software endstops, which count for homed axes only."""
    machine = board.machine
    if "S" in command.words:
        machine.soft_endstops = int(command.values.get("S", 1.0)) > 0
        limit_homed(board)
        return
    shift = machine.motion.modal["shift"][0]
    low, high = machine.motion.modal["low"][0] + shift, machine.motion.modal["high"][0] + shift
    on = machine.soft_endstops
    machine.say(f"  M211 S{int(on)} ; {'ON' if on else 'OFF'}")
    machine.say(
        f"  Min:  X{low[0]:.2f} Y{low[1]:.2f} Z{low[2]:.2f} "
        f"  Max:  X{high[0]:.2f} Y{high[1]:.2f} Z{high[2]:.2f}"
    )


def m75(board: Controller, command: Command) -> None:
    """Start the print timer."""
    board.machine.timer.start(board.machine.now)


def m77(board: Controller, command: Command) -> None:
    """Stop (or, M76, pause) the print timer."""
    board.machine.timer.stop(board.machine.now)


def m85(board: Controller, command: Command) -> None:
    """Time without motion after which the firmware kills itself."""
    if "S" in command.words:
        seconds = command.values.get("S", 0.0)
        # Below 0 the time is over at once: the firmware kills itself.
        board.machine.idle_limit_s = BUILD.at_once_s if seconds < 0 else seconds
        board.machine.idle_since = board.machine.now
    else:
        board.machine.say(f"Inactivity timeout {board.machine.idle_limit_s:.0f} s.")


def m112(board: Controller, command: Command) -> None:
    """Kill; with the emergency parser only that one does it, from the bytes."""
    if not board.machine.printer.emergency_parser:
        board.kill("M112 Shutdown")


def m302(board: Controller, command: Command) -> None:
    """Whether the plunger may move while the hotend is cold."""
    machine = board.machine
    if "S" in command.words:
        machine.heat.coldest_c = float(int(command.values.get("S", 0.0)))
        machine.heat.cold_allowed = machine.heat.coldest_c == 0
    if "P" in command.words:
        machine.heat.cold_allowed = machine.heat.coldest_c == 0 or command.values.get("P", 1.0) != 0
    elif "S" not in command.words:
        state = "en" if machine.heat.cold_allowed else "dis"
        machine.say(f"echo:Cold extrudes are {state}abled (min temp {machine.heat.coldest_c:.0f}C)")


def m501(board: Controller, command: Command) -> None:
    """Load the settings that were stored last, and tell them."""
    board.machine.put_settings(board.machine.stored or board.machine.built)
    board.machine.say(f"echo:V90 stored settings retrieved ({SETTINGS}41")
    board.machine.say("//action:notification Stored settings retrieved")
    tell_settings(board.machine)


def m502(board: Controller, command: Command) -> None:
    """Set the settings as they were built."""
    board.machine.put_settings(board.machine.built)
    board.machine.say("//action:notification Hardcoded Default Settings Loaded")
    board.machine.say("echo:Hardcoded Default Settings Loaded")


def m504(board: Controller, command: Command) -> None:
    """Check the EEPROM."""
    board.machine.say("echo:EEPROM OK")


def m428(board: Controller, command: Command) -> None:
    """Make where the tip stands the home offset; not modelled further than its refusal."""
    if not all(board.machine.homed):
        board.machine.say("echo:Home XYZ First", b"\r\n")


def m999(board: Controller, command: Command) -> None:
    """Restart a stopped machine (not a killed one): asks for the next line."""
    if not command.values.get("S"):
        request_resend(board)


def interpreted(board: Controller, command: Command) -> None:
    """Modal state only."""
    interpret(board.machine.motion.modal[0], board.words[0])


def no_effect(board: Controller, command: Command) -> None:
    """Known, with no effect that is modelled (fans, steppers' power, texts on a display)."""


def g4(board: Controller, command: Command) -> Task:
    """Dwell: the motors stand first."""
    seconds = float(dwell_s(board.words[0]))
    yield STANDSTILL
    yield wait_until(board.machine.now + seconds)


def g28(board: Controller, command: Command) -> Task:
    """Home: a straight run to the low end of each axis; no probing, no second touch.

    A switch stuck closed is found at once, wherever the carriage stands. One stuck open isn't
    found: the axis runs against its end for half its length more, then the firmware stops.
    """
    machine = board.machine
    named = [axis for axis, name in enumerate("XYZ") if name in {*command.values, *command.flags}]
    lows = machine.motion.modal["low"][0].copy()
    for axis in named or (2, 0, 1):
        yield STANDSTILL
        if machine.stuck.get(axis) == "closed":
            machine.motion.stand_at(axis, float(lows[axis]))
        speed = BUILD.homing_z_mm_s if axis == 2 else BUILD.homing_mm_s
        target = machine.motion.modal["position"][0].copy()
        target[axis] = lows[axis]
        machine.motion.modal["position"] = target
        machine.move_to(target, speed, -1)
        yield STANDSTILL
        if machine.stuck.get(axis) == "open":
            length = float(machine.motion.modal["high"][0, axis] - lows[axis])
            yield wait_until(machine.now + length / 2 / speed)
            board.kill("Homing Failed")
            return
        machine.homed[axis] = True
        machine.motion.modal["shift"][0, axis] = 0.0
    limit_homed(board)
    if machine.board.levels_after_homing:
        machine.motion.level(machine.board.bed_slope)
    machine.say(planned_position(board))


def m0(board: Controller, command: Command) -> Task:
    """Wait for the user: M108, or the time of S or P."""
    machine = board.machine
    match = _TEXT.fullmatch(command.text.strip())
    message = match[1].decode("latin-1") if match else ""
    seconds = command.values.get("S", command.values.get("P", 0.0) * 1e-3)
    yield STANDSTILL
    if message:
        machine.say(f"echo:{message}", b"\r\n")
    machine.say("//action:prompt_end")
    stop = "M0 Stop" if command.number == 0 else "M1 Stop"
    machine.say(f"//action:prompt_begin {message or stop}")
    machine.say("//action:prompt_button Continue")
    machine.say("//action:prompt_show")
    machine.waits_for_user = True
    yield wait_for_user(machine.now + seconds if seconds > 0 else math.inf)
    machine.waits_for_user = False


def m104(board: Controller, command: Command) -> None:
    """Target of the hotend, or (M140) of the bed."""
    heater = board.machine.heat.hotend if command.number in (104, 109) else board.machine.heat.bed
    target = command.values.get("S", command.values.get("R"))
    if target is not None and not board.machine.dry:
        heater.set_target(board.machine.now, target)
        if not heater.wired and target > 0:
            board.machine.heat.sensor_fails_at(board.machine.now + BUILD.sensor_fault_s)


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
        near = abs(heater.read(machine.now) - target) < BUILD.window_c
        if near and there_at is None:
            there_at = machine.now
        left = math.inf if there_at is None else there_at + BUILD.residence_s - machine.now
        if machine.now >= report_at:
            rest = "?" if math.isinf(left) else str(max(int(left), 0))
            machine.say(f"{temperatures(machine)} W:{rest}")
            report_at += 1.0
        if left <= 0:
            break
        yield wait_until(min(report_at, machine.now + min(BUILD.look_s, max(left, 1e-3))))
    machine.heat.awaited = False


def m81(board: Controller, command: Command) -> Task:
    """Power off: heaters off, the motors end; the supply itself isn't the board's to switch."""
    board.machine.heat.off(board.machine.now)
    yield STANDSTILL
    yield wait_until(board.machine.now + BUILD.power_off_s)


def m400(board: Controller, command: Command) -> Task:
    """Wait until the motors stand."""
    yield STANDSTILL


def m410(board: Controller, command: Command) -> Steps:
    """Quickstop; with the emergency parser it has happened already when the line is read."""
    return None if board.machine.printer.emergency_parser else quickstop(board)


def m500(board: Controller, command: Command) -> Task:
    """Store the settings; the processor waits for the EEPROM."""
    board.machine.stored = copy_settings(board.machine.motion.planner, board.machine.settings)
    board.machine.stalled_until = board.machine.now + board.machine.board.store_s
    board.hold_busy()
    yield wait_until(board.machine.stalled_until)
    board.machine.say(f"echo:Settings Stored ({SETTINGS})")
    board.machine.say("//action:notification Settings Stored")


HANDLERS: Final[Handlers] = {
    **REPLIES,
    "G4": g4,
    "G21": interpreted,
    "G28": g28,
    "G90": interpreted,
    "G91": interpreted,
    "G92": g92,
    "M0": m0,
    "M1": m0,
    "M75": m75,
    "M76": m77,
    "M77": m77,
    "M81": m81,
    "M82": interpreted,
    "M83": interpreted,
    "M85": m85,
    "M104": m104,
    "M108": no_effect,
    "M109": m109,
    "M112": m112,
    "M140": m104,
    "M190": m109,
    "M211": m211,
    "M302": m302,
    "M400": m400,
    "M410": m410,
    "M500": m500,
    "M501": m501,
    "M502": m502,
    "M428": m428,
    "M504": m504,
    "M999": m999,
    **dict.fromkeys(
        ("M17", "M18", "M84", "M106", "M107", "M117", "M120", "M121", "M876"), no_effect
    ),
}
"""By letter and number, but for G0 to G3 and T."""


class MarlinBuild(NamedTuple):
    """Speeds and waits of the recorded build.

    A function is a generator that yields what it waits for, or does its work at once.
    """

    homing_mm_s: float = 50.0
    homing_z_mm_s: float = 4.0
    residence_s: float = 10.0
    window_c: float = 1.0
    look_s: float = 0.25
    power_off_s: float = 1.0
    sensor_fault_s: float = 0.034
    at_once_s: float = 1e-6


BUILD: Final = MarlinBuild()

_TEXT: Final = re.compile(rb"M *\d+ *(?:[A-Z] *[-+]?\d+\.?\d* *)*(.*)")
"""Behind a code and words with a number."""


def m420(board: Controller, command: Command) -> Task:
    """Switch bed levelling on or off, with the motors at rest; tell which."""
    motion = board.machine.motion
    yield STANDSTILL
    if "S" in command.values:
        motion.level(board.machine.board.bed_slope if command.values["S"] else 0.0)
    board.machine.say(f"echo:Bed Leveling {'ON' if motion.slope else 'OFF'}")


def limit_homed(board: Controller) -> None:
    """Let the software endstops hold on the axes that were homed, while M211 is on."""
    machine = board.machine
    machine.motion.modal["limited"] = [homed and machine.soft_endstops for homed in machine.homed]
