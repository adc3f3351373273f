"""Simulated Duet with RepRapFirmware: Marlin's board part with its own commands and replies."""

from __future__ import annotations

import re
from binascii import crc_hqx
from collections.abc import Callable
from typing import Any, ClassVar, Final

from gcode.program.gcode import Command, checksum
from sim.devices.board.controller import Controller, Firmware, Handlers
from sim.devices.board.machine import Steps
from sim.devices.board.printer import SimulatedPrinter, set_position, take_tool_in_silence
from sim.devices.board.wire import Numbering
from sim.devices.families.marlin_commands import HANDLERS
from sim.devices.families.marlin_printer import HomedFirmware
from sim.devices.families.marlin_reports import place_report, set_flow_percent, set_speed_percent

# Modelled, after its source (`StringParser.cpp`, 3.x): a line with N and a checksum of one to three
# digits (XOR) or five (CRC-16) is checked; a bad one is dropped without a word; numbers aren't
# compared, so a line sent twice is done twice; N without a checksum and lines without N are done as
# they are. No ``Resend``, no busy messages, no M113, M211; M85 is taken and does nothing. Axes are
# moved only once they are homed or G92 has given their place. Wordings of M92, M114, M115, M201,
# M203, M208, of unknown commands, of cold extrusion and of the emergency stop.
#
# It takes Marlin's codes by design, so this twin is Marlin's firmware part with other words and
# commands: what isn't listed here is done and answered as by Marlin.
#
# Not modelled: its motion (Marlin's planner runs here), its macros, object model and expressions,
# tools beyond T P0 and G10 P with offsets, its larger buffers but for what the profile says. After
# the emergency stop a real one still answers; this one is silent.
_MISSING: Final = ("M31", "M75", "M76", "M77", "M113", "M154", "M155", "M211", "M503")


def _m92(board: Controller, command: Command) -> None:
    if command.values:
        HANDLERS["M92"](board, command)
        return
    x, y, z, e = (float(value) for value in board.machine.motion.state["steps_per_mm"])
    board.machine.say(f"Steps/mm: X: {x:.3f}, Y: {y:.3f}, Z: {z:.3f}, E: {e:.3f}")


def _m114(board: Controller, command: Command) -> None:
    counts = " ".join(map(str, board.machine.motion.steps_at(board.machine.now)[:3]))
    place = " ".join(f"{float(v) + 0.0:.3f}" for v in board.machine.motion.modal["position"][0, :3])
    board.machine.say(f"{place_report(board)} E0:0.0 Count {counts} Machine {place} Bed comp 0.000")


def _m669(board: Controller, command: Command) -> None:
    board.machine.say("Kinematics is Cartesian, no segmentation")


def _m115(board: Controller, command: Command) -> None:
    board.machine.say(
        "FIRMWARE_NAME: RepRapFirmware for Duet 3 MB6HC FIRMWARE_VERSION: 3.6.0 "
        "ELECTRONICS: Duet 3 MB6HC v1.02 or later FIRMWARE_DATE: 2025-04-01"
    )


def _listed(values: Any, factor: float = 1.0) -> str:
    return ", ".join(
        f"{axis}: {float(v) * factor:.1f}" for axis, v in zip("XYZE", values, strict=True)
    )


def _m201(board: Controller, command: Command) -> None:
    if command.values:
        HANDLERS["M201"](board, command)
        return
    board.machine.say(
        f"Accelerations (mm/sec^2): {_listed(board.machine.motion.state['max_acceleration'])}"
    )


def _m203(board: Controller, command: Command) -> None:
    """In mm/min, where Marlin's is in mm/s."""
    if not command.values:
        speeds = _listed(board.machine.motion.state["max_speed"], 60.0)
        slowest = board.machine.printer.min_speed_mm_s * 60.0
        board.machine.say(f"Max speeds (mm/min): {speeds}, min. speed {slowest:.2f}")


def _m208(board: Controller, command: Command) -> None:
    modal = board.machine.motion.modal
    spans = zip("XYZ", modal["low"][0], modal["high"][0], strict=True)
    words = ", ".join(f"{axis}{float(low):.1f}:{float(high):.1f}" for axis, low, high in spans)
    board.machine.say(f"Axis limits (mm)s {words}")


def _answers(text: str) -> Callable[[Controller, Command], None]:
    """Answer a question whose setting it leaves as it is."""
    return lambda board, command: board.machine.say(text)


def _g92(board: Controller, command: Command) -> None:
    """Where Marlin reports the position too."""
    set_position(board)


_NUMBER: Final = re.compile(rb"N(\d+)")
_DIGITS: Final = re.compile(rb"\d*")


def crc16(data: bytes) -> int:
    """CRC-16, polynomial 0x1021, start 0, most significant bit first."""
    return crc_hqx(data, 0)


class DuetNumbering(Numbering):
    """RepRapFirmware's line numbering: accepts what isn't provably wrong."""

    def accept(self, line: bytes) -> bytes | None:
        """The command to queue, or None for a line that is dropped."""
        number = _NUMBER.match(line)
        body, star, given = line.partition(b"*")
        if number is None or not star:
            return line
        match = _DIGITS.match(given)
        digits = match[0] if match else b""
        wanted = {1: checksum, 2: checksum, 3: checksum, 5: crc16}.get(len(digits))
        if wanted is None or wanted(body) != int(digits):
            return None
        self.last_number = int(number[1])
        return body


class RepRapFirmware(HomedFirmware):
    """See the module."""

    numbering: ClassVar[type[Numbering]] = DuetNumbering
    handlers: ClassVar[Handlers] = {
        **{name: handler for name, handler in HANDLERS.items() if name not in _MISSING},
        "G20": HANDLERS["G21"],
        "G92": _g92,
        **dict.fromkeys(("M42", "M85", "M280"), HANDLERS["M107"]),  # known, do nothing
        "M92": _m92,
        "M201": _m201,
        "M203": _m203,
        "M208": _m208,
        "M290": _answers("Baby stepping offsets (mm): X:0.000 Y:0.000 Z:0.000"),
        "M564": _answers(
            "Movement outside the bed is not permitted, movement before homing is not permitted"
        ),
        "M114": _m114,
        "M669": _m669,
        "M115": _m115,
        "M220": set_speed_percent,
        "M221": set_flow_percent,
    }
    too_cold_words: ClassVar[str] = (
        "Warning: Tool 0 was not driven because its heater temperatures were not high enough"
    )
    not_homed_words: ClassVar[str] = "Error: G0/G1: insufficient axes homed"
    banner: ClassVar[tuple[str, ...]] = ()
    offsets_by: ClassVar[str] = "G10"

    def start(self, command: Command) -> Steps:
        """Begin a command; G92 gives axes a place."""
        if command.name == "G92":
            self.placed |= command.values.keys() & {"X", "Y", "Z"}
        return super().start(command)

    def take_tool(self, command: Command) -> Steps:
        """T: none with that number deselects all, and is no head here; T alone tells."""
        machine, count = self.board.machine, self.board.machine.printer.tool_count
        if count == 1:
            return None
        if 0 <= command.number < count:
            return take_tool_in_silence(self.board, command.number)
        if command.number < 0:
            machine.say(f"Tool {machine.motion.tool} is selected")
        else:
            machine.say(f"Error: Tool {command.number} not found")
        return None

    def say_unknown(self, command: Command) -> None:
        """There is no such command."""
        self.board.machine.say(f"Warning: {command.name}: Command is not supported")

    def say_halted(self, reason: str) -> None:
        """It stops for good."""
        self.board.machine.say("Emergency Stop! Reset the controller to continue.")


class DuetPrinter(SimulatedPrinter):
    """A board with RepRapFirmware; see the module."""

    firmware_class: ClassVar[type[Firmware]] = RepRapFirmware


PRINTER: Final = DuetPrinter
