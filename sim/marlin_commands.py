"""What each command does that isn't a move: a function per code, found by its name.

A function either does its work at once or is a generator that yields what it waits for.
Wordings and line ends are those of the recorded build (`tests/sim/data/marlin`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Final

from sim.gcode import Command
from sim.gcode_modal import dwell_s, interpret
from sim.marlin_machine import COLD_C, QUICKSTOP_S, Place, Still, Until, User, Wait
from sim.marlin_settings import SETTINGS_HANDLERS
from sim.marlin_texts import SETTINGS, identity

if TYPE_CHECKING:
    from sim.marlin import MarlinPrinter

Steps = Iterator[Wait] | None
Handler = Callable[["MarlinPrinter", Command], Steps]

_RESIDENCE_S: Final = 10.0
_WINDOW_C: Final = 1.0
_LOOK_S: Final = 0.25
_SENSOR_FAULT_S: Final = 0.034


def position_report(board: MarlinPrinter, counts: list[int]) -> str:
    """X to E as the user numbers them, then the steps of x, y and z."""
    machine = board.machine
    position = machine.modal["position"][0]
    shift = machine.modal["shift"][0]
    x, y, z = (position[axis] + shift[axis] for axis in range(3))
    return (
        f"X:{_two(x)} Y:{_two(y)} Z:{_two(z)} E:{_two(position[3])} "
        f"Count X:{counts[0]} Y:{counts[1]} Z:{counts[2]}"
    )


def _two(value: float) -> str:
    return f"{value + 0.0:.2f}"


def planned_position(board: MarlinPrinter) -> str:
    """Report of M114: counts are those at the end of the last block taken."""
    return position_report(board, [int(v) for v in board.machine.planner["position"][0]])


def g4(board: MarlinPrinter, command: Command) -> Iterator[Wait]:
    """Dwell: the motors stand first."""
    seconds = float(dwell_s(board.words[0]))
    yield Still()
    yield Until(board.machine.now + seconds)


def g28(board: MarlinPrinter, command: Command) -> Iterator[Wait]:
    """Home: a straight run to the low end of each axis; no probing, no second touch."""
    machine = board.machine
    named = [axis for axis, name in enumerate("XYZ") if name in {*command.values, *command.flags}]
    lows = machine.modal["low"][0].copy()
    for axis in named or (2, 0, 1):
        yield Still()
        target = machine.modal["position"][0].copy()
        target[axis] = lows[axis]
        machine.modal["position"] = target
        machine.move_to(target, 4.0 if axis == 2 else 50.0, -1)
        yield Still()
        machine.homed[axis] = True
        machine.modal["shift"][0, axis] = 0.0
    _limit(board)
    machine.say(planned_position(board))


def _limit(board: MarlinPrinter) -> None:
    machine = board.machine
    machine.modal["limited"] = [homed and machine.soft_endstops for homed in machine.homed]


def g92(board: MarlinPrinter, command: Command) -> None:
    """Give the position other numbers, then report where the motors are."""
    machine = board.machine
    before = float(machine.modal["position"][0, 3])
    interpret(machine.modal[0], board.words[0])
    after = float(machine.modal["position"][0, 3])
    if after != before:
        machine.set_plunger(after)
    machine.say(position_report(board, machine.steps_now()))


def m0(board: MarlinPrinter, command: Command) -> Iterator[Wait]:
    """Wait for the user: M108, or the time of S or P."""
    machine = board.machine
    message = command.text.partition(b" ")[2].decode("latin-1").strip()
    seconds = command.values.get("S", command.values.get("P", 0.0) * 1e-3)
    yield Still()
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


def m31(board: MarlinPrinter, command: Command) -> None:
    """Print time."""
    seconds = int(board.machine.timer.read(board.machine.now))
    parts = [(seconds // 86400, "d"), (seconds // 3600 % 24, "h"), (seconds // 60 % 60, "m")]
    while parts and parts[0][0] == 0:
        parts.pop(0)
    text = " ".join(f"{value}{unit}" for value, unit in [*parts, (seconds % 60, "s")])
    board.machine.say(f"echo:Print time: {text}")


def m75(board: MarlinPrinter, command: Command) -> None:
    """Start the print timer."""
    board.machine.timer.start(board.machine.now)


def m77(board: MarlinPrinter, command: Command) -> None:
    """Stop (or, M76, pause) the print timer."""
    board.machine.timer.stop(board.machine.now)


def m85(board: MarlinPrinter, command: Command) -> None:
    """Time without motion after which the firmware kills itself."""
    if "S" in command.values:
        board.machine.idle_limit_s = command.values["S"]
        board.machine.idle_since = board.machine.now


def m104(board: MarlinPrinter, command: Command) -> None:
    """Target of the hotend, or (M140) of the bed."""
    heater = board.machine.hotend if command.number in (104, 109) else board.machine.bed
    target = command.values.get("S", command.values.get("R"))
    if target is not None:
        heater.set_target(board.machine.now, target)
        if not heater.wired and target > 0:
            board.sensor_fails_at(board.machine.now + _SENSOR_FAULT_S)


def m105(board: MarlinPrinter, command: Command) -> None:
    """Temperatures behind an ok of its own."""
    board.say_ok(board.machine.temperatures())


def m109(board: MarlinPrinter, command: Command) -> Iterator[Wait]:
    """Wait for the hotend, or (M190) the bed: S while it heats, R while it cools as well."""
    machine = board.machine
    m104(board, command)
    heater = machine.hotend if command.number == 109 else machine.bed
    target = heater.target_c
    if "R" not in command.values and heater.read(machine.now) > target:
        return
    machine.waits_for_heat = True
    report_at = machine.now
    there_at: float | None = None
    while machine.waits_for_heat:
        near = abs(heater.read(machine.now) - target) < _WINDOW_C
        if near and there_at is None:
            there_at = machine.now
        left = math.inf if there_at is None else there_at + _RESIDENCE_S - machine.now
        if machine.now >= report_at:
            rest = "?" if math.isinf(left) else str(max(int(left), 0))
            machine.say(f"{machine.temperatures()} W:{rest}")
            report_at += 1.0
        if left <= 0:
            break
        yield Until(min(report_at, machine.now + min(_LOOK_S, max(left, 1e-3))))
    machine.waits_for_heat = False


def m110(board: MarlinPrinter, command: Command) -> None:
    """Set or tell the last line number."""
    position = command.values.get("N")
    if position is None:
        board.machine.say(f"Line: {board.lines.last_number}")
    else:
        board.lines.last_number = int(position)


def m111(board: MarlinPrinter, command: Command) -> None:
    """Debug flags."""
    machine = board.machine
    if "S" in command.values:
        machine.debug = int(command.values["S"])
    names = ("ECHO", "INFO", "ERRORS", "DRYRUN", "COMMUNICATION")
    on = [name for bit, name in enumerate(names) if machine.debug >> bit & 1]
    machine.say("echo:DEBUG:" + (",".join(on) if on else "Off"))


def m112(board: MarlinPrinter, command: Command) -> None:
    """Kill."""
    board.kill("M112 Shutdown")


def m113(board: MarlinPrinter, command: Command) -> None:
    """Interval of the busy message."""
    if "S" in command.values:
        board.machine.reports.keepalive_s = min(max(command.values["S"], 0.0), 60.0)
    else:
        board.machine.say(f"echo:M113 S{board.machine.reports.keepalive_s:g}")


def m114(board: MarlinPrinter, command: Command) -> None:
    """Position at the end of the last move taken."""
    board.machine.say(planned_position(board))


def m115(board: MarlinPrinter, command: Command) -> None:
    """Who the firmware is."""
    for line in identity(board.machine.printer):
        board.machine.say(line)


def m118(board: MarlinPrinter, command: Command) -> None:
    """Say the text: E1 puts echo: before it, A1 makes it an action."""
    text = command.text[4:].lstrip(b" ")
    prefix = b""
    while text[:1] in (b"E", b"A", b"P") and text[1:2].isdigit():
        if text[1:2] != b"0":
            prefix += {b"E": b"echo:", b"A": b"//"}.get(text[:1], b"")
        text = text[2:].lstrip(b" ")
    board.machine.say(prefix + text, b"\r\n")


def m119(board: MarlinPrinter, command: Command) -> None:
    """Endstops: all open."""
    for line in ("Reporting endstop status", "x_min: open", "y_min: open", "z_min: open"):
        board.machine.say(line)


def m154(board: MarlinPrinter, command: Command) -> None:
    """Interval of the position report."""
    reports = board.machine.reports
    if "S" in command.values:
        reports.position_s = command.values["S"]
        reports.position_at = board.machine.now + reports.position_s
        if reports.position_s <= 0:
            reports.position_at = math.inf


def m155(board: MarlinPrinter, command: Command) -> None:
    """Interval of the temperature report."""
    reports = board.machine.reports
    if "S" in command.values:
        reports.temperature_s = command.values["S"]
        reports.temperature_at = board.machine.now + reports.temperature_s
        if reports.temperature_s <= 0:
            reports.temperature_at = math.inf


def m211(board: MarlinPrinter, command: Command) -> None:
    """Software endstops, which count for homed axes only."""
    machine = board.machine
    if "S" in command.values:
        machine.soft_endstops = command.values["S"] != 0
        _limit(board)
        return
    low, high = machine.modal["low"][0], machine.modal["high"][0]
    on = machine.soft_endstops
    machine.say(f"  M211 S{int(on)} ; {'ON' if on else 'OFF'}")
    machine.say(
        f"  Min:  X{low[0]:.2f} Y{low[1]:.2f} Z{low[2]:.2f} "
        f"  Max:  X{high[0]:.2f} Y{high[1]:.2f} Z{high[2]:.2f}"
    )


def m220(board: MarlinPrinter, command: Command) -> None:
    """Feed factor."""
    interpret(board.machine.modal[0], board.words[0])
    if "S" not in command.values:
        board.machine.say(f"FR:{board.machine.modal['speed_percent'][0]:.0f}%")


def m221(board: MarlinPrinter, command: Command) -> None:
    """Flow factor."""
    machine = board.machine
    interpret(machine.modal[0], board.words[0])
    percent = float(machine.modal["flow_percent"][0])
    machine.planner["flow"] = percent * 0.01
    if "S" not in command.values:
        machine.say(f"echo:E0 Flow: {percent:.0f}%")


def m302(board: MarlinPrinter, command: Command) -> None:
    """Whether the plunger may move while the hotend is cold."""
    machine = board.machine
    if "S" in command.values:
        machine.coldest_c = command.values["S"]
        machine.cold_allowed = machine.coldest_c == 0
    if "P" in command.values or "P" in command.flags:
        machine.cold_allowed = command.values.get("P", 1.0) != 0
        machine.coldest_c = machine.coldest_c or COLD_C
    elif "S" not in command.values:
        state = "en" if machine.cold_allowed else "dis"
        machine.say(f"echo:Cold extrudes are {state}abled (min temp {machine.coldest_c:.0f}C)")


def m400(board: MarlinPrinter, command: Command) -> Iterator[Wait]:
    """Wait until the motors stand."""
    yield Still()


def m410(board: MarlinPrinter, command: Command) -> Steps:
    """Quickstop; with the emergency parser it has happened already when the line is read."""
    return None if board.machine.printer.emergency_parser else quickstop(board)


def quickstop(board: MarlinPrinter) -> Iterator[Wait]:
    """Drop all moves at once; for a second the planner takes no others."""
    machine = board.machine
    machine.stop()
    machine.closed_until = machine.now + QUICKSTOP_S
    yield Still()


def m500(board: MarlinPrinter, command: Command) -> None:
    """Store the settings."""
    board.machine.say(f"echo:Settings Stored ({SETTINGS})")
    board.machine.say("//action:notification Settings Stored")


def m501(board: MarlinPrinter, command: Command) -> None:
    """Load the settings."""
    board.machine.say(f"echo:V90 stored settings retrieved ({SETTINGS}41")
    board.machine.say("//action:notification Stored settings retrieved")


def m502(board: MarlinPrinter, command: Command) -> None:
    """Reset the settings."""
    board.machine.say("echo:Hardcoded Default Settings Loaded")
    board.machine.say("//action:notification Hardcoded Default Settings Loaded")


def m999(board: MarlinPrinter, command: Command) -> None:
    """Restart a stopped machine (not a killed one): asks for the next line."""
    if not command.values.get("S"):
        board.request_resend()


def interpreted(board: MarlinPrinter, command: Command) -> None:
    """Modal state only."""
    interpret(board.machine.modal[0], board.words[0])


def nothing(board: MarlinPrinter, command: Command) -> None:
    """Known, with no effect that is modelled (fans, steppers' power, texts on a display)."""


HANDLERS: Final[dict[str, Handler]] = {
    "G4": g4,
    "G20": interpreted,
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
    "M82": interpreted,
    "M83": interpreted,
    "M85": m85,
    "M104": m104,
    "M105": m105,
    "M108": nothing,
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
    "M999": m999,
    **SETTINGS_HANDLERS,
    **dict.fromkeys(
        ("M17", "M18", "M84", "M106", "M107", "M117", "M149", "M428", "M504", "M876"), nothing
    ),
}
"""By letter and number, but for G0 to G3 (`sim.marlin`) and T."""

__all__ = ["HANDLERS", "Place", "Steps", "planned_position", "quickstop"]
