"""Replies of a simulated Marlin: line numbers, emergency codes, reports and settings."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

from firmware_profiles import Printer
from gcode.program.gcode import Command, checksum
from sim.devices.board.controller import Controller, Handlers
from sim.devices.board.machine import STANDSTILL, Machine, Task
from sim.devices.board.wire import Numbering, RefusedLine

_INTEGER: Final = re.compile(rb"\s*([+-]?\d+)")
LINE_NUMBER: Final = b"Line Number is not Last Line Number+1"
CHECKSUM: Final = b"checksum mismatch"
NO_CHECKSUM: Final = b"No Checksum with line number"


def to_integer(text: bytes) -> int:
    """Leading integer as C's strtol reads it; 0 where there is none."""
    match = _INTEGER.match(text)
    return int(match[1]) if match else 0


class MarlinNumbering(Numbering):
    """Takes the next number with a good checksum."""

    def accept(self, line: bytes) -> bytes | RefusedLine | None:
        """The command to queue; `RefusedLine`; or None for a repeated line, which is dropped.

        A line without a number is taken as it is, whatever its checksum.
        """
        if not line.startswith(b"N"):
            return line
        renumbers = b"M110" in line
        at = max(line.find(b"N", 4), 0) if renumbers else 0
        number = to_integer(line[at + 1 :])
        if number != self.last_number + 1 and not renumbers:
            if self.last_number - 1 <= number <= self.last_number:
                return None
            return RefusedLine(LINE_NUMBER)
        star = line.rfind(b"*")
        if star < 0:
            return RefusedLine(NO_CHECKSUM)
        if to_integer(line[star + 1 :]) != checksum(line[:star]):
            return RefusedLine(CHECKSUM)
        self.last_number = number
        return line


def request_resend(board: Controller) -> None:
    """Ask for the line after the last good one; what is in the ring is thrown away."""
    board.wire.deliver(board.machine.now)
    board.wire.flush()
    board.machine.say(f"Resend: {board.lines.last_number + 1}")
    board.machine.say("ok")


# With EMERGENCY_PARSER they act as their bytes arrive, wherever they stand in the line of commands;
# without, as their line enters the queue.
EMERGENCY: Final = re.compile(rb" *(?:N[0-9 -]*)?M *(108|112|410)")
"""Begin of a line that the emergency parser acts on."""
QUICKSTOP_S: Final = 1.024
"""For so long after a quickstop the planner takes no moves: 1000 ticks at 976.6 Hz."""


def quickstop(board: Controller) -> Task:
    """Drop all moves at once; for a second the planner takes no others."""
    machine = board.machine
    machine.motion.stop(machine.now)
    machine.motion.closed_until = machine.now + QUICKSTOP_S
    yield STANDSTILL


_M118: Final = re.compile(rb"M *0*118 *")
_PREFIX: Final = re.compile(rb"([EA](?=1)|P(?=\d)). *")


def planned_position(board: Controller) -> str:
    """Report of M114: X to E as the user numbers them, then the motors' steps at this moment."""
    machine = board.machine
    counts = machine.motion.steps_at(machine.now)
    position = machine.motion.modal["position"][0]
    shift = machine.motion.modal["shift"][0]
    x, y, z = (position[axis] + shift[axis] for axis in range(3))
    return (
        f"X:{_two(x)} Y:{_two(y)} Z:{_two(z)} E:{_two(position[3])} "
        f"Count X:{counts[0]} Y:{counts[1]} Z:{counts[2]}"
    )


def _two(value: float) -> str:
    return f"{value + 0.0:.2f}"


def place_report(board: Controller) -> str:
    """X to E as the user numbers them, with three decimals (RepRapFirmware, Klipper)."""
    modal = board.machine.motion.modal
    at, shift = modal["position"][0], modal["shift"][0]
    x, y, z = (float(at[k] + shift[k]) + 0.0 for k in range(3))
    return f"X:{x:.3f} Y:{y:.3f} Z:{z:.3f} E:{float(at[3]) + 0.0:.3f}"


def temperatures(machine: Machine) -> str:
    """Report of M105, from the blank on."""
    heat, now = machine.heat, machine.now
    return (
        f" T:{heat.hotend.read(now):.2f} /{heat.hotend.target_c:.2f}"
        f" B:{heat.bed.read(now):.2f} /{heat.bed.target_c:.2f}"
        f" @:{heat.hotend.duty(now)} B@:{heat.bed.duty(now)}"
    )


def m31(board: Controller, command: Command) -> None:
    """Print time."""
    seconds = int(board.machine.timer.read(board.machine.now))
    parts = [(seconds // 86400, "d"), (seconds // 3600 % 24, "h"), (seconds // 60 % 60, "m")]
    while parts and parts[0][0] == 0:
        parts.pop(0)
    text = " ".join(f"{value}{unit}" for value, unit in [*parts, (seconds % 60, "s")])
    board.machine.say(f"echo:Print time: {text}")


def m105(board: Controller, command: Command) -> None:
    """Temperatures behind an ok of its own."""
    board.say_ok(temperatures(board.machine))


def m110(board: Controller, command: Command) -> None:
    """Set or tell the last line number."""
    position = command.values.get("N")
    if position is None:
        board.machine.say(f"Line: {board.lines.last_number}")
    else:
        board.lines.last_number = int(position)


def m111(board: Controller, command: Command) -> None:
    """Debug flags."""
    machine = board.machine
    if "S" in command.values:
        machine.debug = min(max(int(command.values["S"]), 0), 255)
    names = ("ECHO", "INFO", "ERRORS", "DRYRUN", "COMMUNICATION")
    on = [name for bit, name in enumerate(names) if machine.debug >> bit & 1]
    machine.say("echo:DEBUG:" + (",".join(on) if machine.debug else "off"))


def m113(board: Controller, command: Command) -> None:
    """Interval of the busy message."""
    if "S" in command.values:
        board.machine.reports.keepalive_s = float(min(max(int(command.values["S"]), 0), 60))
    else:
        board.machine.say(f"echo:M113 S{board.machine.reports.keepalive_s:g}")


def m114(board: Controller, command: Command) -> None:
    """Position at the end of the last move taken."""
    board.machine.say(planned_position(board))


def m115(board: Controller, command: Command) -> None:
    """Who the firmware is."""
    for line in identity(board.machine.printer):
        board.machine.say(line)


def m118(board: Controller, command: Command) -> None:
    """Say the text: E1 puts echo: before it, A1 makes it an action, P with a digit is dropped."""
    text = _M118.sub(b"", command.text, count=1)
    words = b""
    while (match := _PREFIX.match(text)) is not None:
        words += match[1]
        text = text[match.end() :]
    prefix = b"echo:" * (b"E" in words) + b"//" * (b"A" in words)
    board.machine.say(prefix + text, b"\r\n")


def m119(board: Controller, command: Command) -> None:
    """Endstops: open, but for one that is stuck."""
    board.machine.say("Reporting endstop status")
    for axis, name in enumerate("xyz"):
        closed = board.machine.stuck.get(axis) == "closed"
        board.machine.say(f"{name}_min: {'TRIGGERED' if closed else 'open'}")


def m155(board: Controller, command: Command) -> None:
    """Interval of the temperature report, or (M154) of the position's."""
    reports = board.machine.reports
    report = reports.position if command.number == 154 else reports.temperature
    if "S" in command.values:
        report.set(command.values["S"], board.machine.now)


# The settings' image in the EEPROM isn't modelled: its size and CRC are those of the recorded
# build.
UUID: Final = "cede2a2f-41a2-4748-9b12-c55c62f367ff"
SETTINGS: Final = "597 bytes; crc 27963"
_CAPABILITIES: Final = """
SERIAL_XON_XOFF:0 BINARY_FILE_TRANSFER:0 EEPROM:1 VOLUMETRIC:1 AUTOREPORT_POS:1 AUTOREPORT_TEMP:1
PROGRESS:0 PRINT_JOB:1 AUTOLEVEL:0 RUNOUT:0 Z_PROBE:0 LEVELING_DATA:0 BUILD_PERCENT:0
SOFTWARE_POWER:0 TOGGLE_LIGHTS:0 CASE_LIGHT_BRIGHTNESS:0 EMERGENCY_PARSER:{emergency}
HOST_ACTION_COMMANDS:1 PROMPT_SUPPORT:1 SDCARD:0 REPEAT:0 SD_WRITE:0 AUTOREPORT_SD_STATUS:0
LONG_FILENAME:0 LFN_WRITE:0 CUSTOM_FIRMWARE_UPLOAD:0 EXTENDED_M20:0 THERMAL_PROTECTION:1
MOTION_MODES:0 ARCS:1 BABYSTEPPING:0 EP_BABYSTEP:0 CHAMBER_TEMPERATURE:0 COOLER_TEMPERATURE:0
MEATPACK:0 CONFIG_EXPORT:0
"""


def _corner(printer: Printer, end: str) -> str:
    values = (getattr(span, end) for span in (printer.x_mm, printer.y_mm, printer.z_mm))
    return "{" + ",".join(f"{a}:{v:.2f}" for a, v in zip("xyz", values, strict=True)) + "}"


def identity(printer: Printer) -> list[str]:
    """Lines of M115, without the ok."""
    box = f"{{min:{_corner(printer, 'low')},max:{_corner(printer, 'high')}}}"
    return [
        "FIRMWARE_NAME:Marlin bugfix-2.1.x (Nov 20 2026 03:35:05) "
        "SOURCE_CODE_URL:github.com/MarlinFirmware/Marlin PROTOCOL_VERSION:1.0 "
        "MACHINE_TYPE:3D Printer KINEMATICS:Cartesian "
        f"EXTRUDER_COUNT:{printer.tool_count} UUID:{UUID}",
        *(
            f"Cap:{word}"
            for word in _CAPABILITIES.format(emergency=int(printer.emergency_parser)).split()
        ),
        f"area:{{full:{box},work:{box}}}",
    ]


BANNER: Final = (
    "start",
    "Marlin bugfix-2.1.x",
    "echo: Last Updated: 2024-10-11 | Author: (none, default config)",
    "echo: Compiled: Nov 20 2026",
    "echo: Free Memory: 5322  PlannerBufferBytes: 1264",
    # The real firmware prints the closing bracket as a number, 41.
    f"echo:V90 stored settings retrieved ({SETTINGS}41",
    "//action:notification Stored settings retrieved",
    "//action:prompt_end",
)
"""What a board says after a reset."""


# A step count, speed or acceleration of 0 or less is reported as it was set, as by Marlin, but
# not kept to: what Marlin makes of it isn't modelled.
_AXES: Final = "XYZE"
_NETFABB_STEPS: Final = 20.0


def _axes(machine: Machine, field: str) -> str:
    values = [
        machine.settings.reported_only.get((field, axis), float(value))
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


def _set_axes(field: str, board: Controller, command: Command) -> None:
    machine, values = board.machine, command.values
    for axis, letter in enumerate(_AXES):
        if letter not in values:
            continue
        machine.settings.reported_only.pop((field, axis), None)
        if values[letter] > 0:
            machine.motion.state[field][axis] = values[letter]
        else:
            machine.settings.reported_only[field, axis] = values[letter]


def _change_steps(board: Controller, command: Command) -> None:
    """Set steps/mm; where the motors stand is then counted in the new ones.

    Below 20 on E, Marlin takes it for a change of units and scales E's greatest speed with it.
    """
    machine, values = board.machine, command.values
    if 0 < values.get("E", 0.0) < _NETFABB_STEPS:
        machine.motion.state["max_speed"][3] *= (
            float(machine.motion.state["steps_per_mm"][3]) / values["E"]
        )
    _set_axes("steps_per_mm", board, command)
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
    "M201": ("XYZE", partial(_set_axes, "max_acceleration")),
    "M203": ("XYZE", partial(_set_axes, "max_speed")),
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


def _whole(command: Command) -> Command:
    """With the percentage as a 16-bit whole number.

    Marlin reads their percentages as 16-bit whole numbers: M220 S50.7 is 50 %, S40000 is -25536 %.
    RepRapFirmware and Klipper keep the fraction.
    """
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
    """Feed factor: S sets it, B keeps it aside, R takes that back; reported without words."""
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


REPLIES: Final[Handlers] = {
    **dict.fromkeys(_CHANGES, _setting),
    "M31": m31,
    "M105": m105,
    "M110": m110,
    "M111": m111,
    "M113": m113,
    "M114": m114,
    "M115": m115,
    "M118": m118,
    "M119": m119,
    "M154": m155,
    "M155": m155,
    "M200": m200,
    "M220": m220,
    "M221": m221,
    "M503": m503,
}
"""Commands that report, or change what is reported."""
