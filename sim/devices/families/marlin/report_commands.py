"""Marlin's reporting commands and report intervals: M31, M105, M110 to M119, M154, M155."""

from __future__ import annotations

import math
import re
from typing import Final

from firmware_profiles import Printer
from sim.devices.board.controller import Controller
from sim.devices.board.machine import STANDSTILL, Machine, Steps, Task
from sim.devices.board.wire import RefusedLine
from sim.gcode.program.gcode import Command, checksum

# Marlin's line numbers, checksums and resend requests; emergency codes that bypass the queue.

_INTEGER: Final = re.compile(rb"\s*([+-]?\d+)")
LINE_NUMBER: Final = b"Line Number is not Last Line Number+1"
CHECKSUM: Final = b"checksum mismatch"
NO_CHECKSUM: Final = b"No Checksum with line number"


def to_integer(text: bytes) -> int:
    """Leading integer as C's strtol reads it; 0 where there is none."""
    match = _INTEGER.match(text)
    return int(match[1]) if match else 0


class MarlinNumbering:
    """Takes the next number with a good checksum.

    Attributes
    ----------
    last_number : int
        Of the last accepted line.
    """

    def __init__(self) -> None:
        self.last_number = 0

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

    def clear(self) -> None:
        """Forget the numbers, as a reset does."""
        self.last_number = 0


def request_resend(board: Controller) -> None:
    """Ask for the line after the last good one; what is in the ring is thrown away."""
    board.wire.deliver(board.machine.now)
    board.wire.flush()
    board.machine.say(f"Resend: {board.lines.last_number + 1}")
    board.machine.say("ok")


# Marlin's emergency codes, which bypass the queue: M108, M112 and M410.
#
# With EMERGENCY_PARSER they act as their bytes arrive, wherever they stand in the line of commands;
# without, as their line enters the queue.

EMERGENCY: Final = re.compile(rb" *(?:N[0-9 -]*)?M *(108|112|410)")
"""Begin of a line that the emergency parser acts on."""
QUICKSTOP_S: Final = 1.024
"""For so long after a quickstop the planner takes no moves: 1000 ticks at 976.6 Hz."""
_NAMES: Final = (b"M112", b"M410", b"M108")


def code_on_entering(line: bytes) -> bytes | None:
    """The code of a line that acts as it enters the queue, where there is no emergency parser."""
    return line[1:4] if line[:4] in _NAMES else None


def act_urgently(board: Controller, code: bytes) -> Steps:
    """Kill (M112), end a wait (M108), or drop all moves (M410)."""
    machine = board.machine
    if code == b"112":
        board.kill("M112 Shutdown")
    elif code == b"108":
        machine.waits_for_user = False
        machine.heat.awaited = False
    else:
        return quickstop(board)
    return None


def quickstop(board: Controller) -> Task:
    """Drop all moves at once; for a second the planner takes no others."""
    machine = board.machine
    machine.stop()
    machine.motion.closed_until = machine.now + QUICKSTOP_S
    yield STANDSTILL


_NUMBER_WORD: Final = re.compile(rb"N[-0-9]*")
_M118: Final = re.compile(rb"M *0*118 *")
_PREFIX: Final = re.compile(rb"([EA](?=1)|P(?=\d)). *")


def position_report(board: Controller, counts: list[int]) -> str:
    """X to E as the user numbers them, then the steps of x, y and z."""
    machine = board.machine
    position = machine.motion.modal["position"][0]
    shift = machine.motion.modal["shift"][0]
    x, y, z = (position[axis] + shift[axis] for axis in range(3))
    return (
        f"X:{_two(x)} Y:{_two(y)} Z:{_two(z)} E:{_two(position[3])} "
        f"Count X:{counts[0]} Y:{counts[1]} Z:{counts[2]}"
    )


def _two(value: float) -> str:
    return f"{value + 0.0:.2f}"


def temperatures(machine: Machine) -> str:
    """Report of M105, from the blank on."""
    heat, now = machine.heat, machine.now
    return (
        f" T:{heat.hotend.read(now):.2f} /{heat.hotend.target_c:.2f}"
        f" B:{heat.bed.read(now):.2f} /{heat.bed.target_c:.2f}"
        f" @:{heat.hotend.duty(now)} B@:{heat.bed.duty(now)}"
    )


def planned_position(board: Controller) -> str:
    """Report of M114: counts are the motors' own at this moment."""
    return position_report(board, board.machine.steps_now())


def ok_words(board: Controller) -> str:
    """Words behind an ok: with ADVANCED_OK line number, free planner blocks and places in line."""
    machine, work = board.machine, board.work
    if not machine.printer.advanced_ok:
        return ""
    word = _NUMBER_WORD.match(work.line)
    number = f" {word[0].decode()}" if word else ""
    blocks = len(machine.motion.ring) - 1 - machine.motion.blocks
    return f"{number} P{blocks} B{machine.printer.command_queue - max(len(work.queue), 1)}"


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


def m154(board: Controller, command: Command) -> None:
    """Interval of the position report."""
    reports = board.machine.reports
    if "S" in command.values:
        reports.position_s = command.values["S"]
        reports.position_at = board.machine.now + reports.position_s
        if reports.position_s <= 0:
            reports.position_at = math.inf


def m155(board: Controller, command: Command) -> None:
    """Interval of the temperature report."""
    reports = board.machine.reports
    if "S" in command.values:
        reports.temperature_s = command.values["S"]
        reports.temperature_at = board.machine.now + reports.temperature_s
        if reports.temperature_s <= 0:
            reports.temperature_at = math.inf


# Long replies of a real Marlin build (`tests/sim/data/marlin`): M115 and boot banner.
#
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
        f"EXTRUDER_COUNT:{printer.head_count} UUID:{UUID}",
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
