"""Table of Marlin's command handlers by code, and the small ones themselves (M75, M85, M302…).

Wordings and line ends are those of the recorded build (`tests/sim/data/marlin`).
"""

from __future__ import annotations

from typing import Final

from sim.devices.board.controller import Controller, Handlers
from sim.devices.board.moves import set_position
from sim.devices.families.marlin.factors import m220, m221
from sim.devices.families.marlin.numbering import request_resend
from sim.devices.families.marlin.report_commands import (
    m31,
    m105,
    m110,
    m111,
    m113,
    m114,
    m115,
    m118,
    m119,
    m154,
    m155,
    position_report,
)
from sim.devices.families.marlin.settings import SETTINGS_HANDLERS, tell_settings
from sim.devices.families.marlin.texts import SETTINGS
from sim.devices.families.marlin.waits import (
    g4,
    g28,
    limit_homed,
    m0,
    m81,
    m104,
    m109,
    m400,
    m410,
    m500,
)
from sim.gcode.program.gcode import Command
from sim.gcode.program.modal import interpret

_AT_ONCE_S: Final = 1e-6


def g92(board: Controller, command: Command) -> None:
    """Give the position other numbers, then report where the motors are."""
    set_position(board)
    board.machine.say(position_report(board, board.machine.steps_now()))


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
        board.machine.idle_limit_s = _AT_ONCE_S if seconds < 0 else seconds
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


HANDLERS: Final[Handlers] = {
    "G4": g4,
    "G21": interpreted,
    "G28": g28,
    "G90": interpreted,
    "G91": interpreted,
    "G92": g92,
    "M0": m0,
    "M1": m0,
    "M31": m31,
    "M75": m75,
    "M76": m77,
    "M77": m77,
    "M81": m81,
    "M82": interpreted,
    "M83": interpreted,
    "M85": m85,
    "M104": m104,
    "M105": m105,
    "M108": no_effect,
    "M109": m109,
    "M110": m110,
    "M111": m111,
    "M112": m112,
    "M113": m113,
    "M114": m114,
    "M115": m115,
    "M118": m118,
    "M119": m119,
    "M140": m104,
    "M154": m154,
    "M155": m155,
    "M190": m109,
    "M211": m211,
    "M220": m220,
    "M221": m221,
    "M302": m302,
    "M400": m400,
    "M410": m410,
    "M500": m500,
    "M501": m501,
    "M502": m502,
    "M428": m428,
    "M504": m504,
    "M999": m999,
    **SETTINGS_HANDLERS,
    **dict.fromkeys(
        ("M17", "M18", "M84", "M106", "M107", "M117", "M120", "M121", "M876"), no_effect
    ),
}
"""By letter and number, but for G0 to G3 and T."""
