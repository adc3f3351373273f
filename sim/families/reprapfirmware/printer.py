"""A simulated Duet: what RepRapFirmware does otherwise than Marlin on the wire. Not verified.

Modelled, after its source (`StringParser.cpp`, 3.x): a line with N and a checksum of one to three
digits (XOR) or five (CRC-16) is checked; a bad one is dropped without a word; numbers aren't
compared, so a line sent twice is done twice; N without a checksum and lines without N are done as
they are. No ``Resend``, no busy messages, no M113, M211; M85 is taken and does nothing. Axes are
moved only once they are homed or G92 has said where they are. Wordings of M92, M114, M115, M201,
M203, M208, of unknown commands, of cold extrusion and of the emergency stop.

Not modelled: its motion (Marlin's planner runs here), its macros, object model and expressions,
tools beyond T P0 and G10 P with offsets, its larger buffers but for what the profile says. After
the emergency stop a real one still answers; this one is silent.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Final

from sim.gcode import Command, checksum
from sim.marlin import MarlinPrinter
from sim.marlin_commands import HANDLERS, Handler
from sim.marlin_lines import LineReader
from sim.marlin_loop import MainLoop
from sim.marlin_machine import Wait
from sim.marlin_tools import take_tool_in_silence
from sim.marlin_waits import Steps

_NUMBER: Final = re.compile(rb"N(\d+)")
_DIGITS: Final = re.compile(rb"\d*")
_MISSING: Final = ("M31", "M75", "M76", "M77", "M113", "M154", "M155", "M211", "M503")


def crc16(data: bytes) -> int:
    """CRC-16, polynomial 0x1021, start 0, most significant bit first."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    return crc


class DuetLines(LineReader):
    """Takes what isn't provably wrong."""

    def accept(self, line: bytes) -> bytes | None:
        """The command to queue, or None for a line that is dropped."""
        number = _NUMBER.match(line)
        body, star, given = line.partition(b"*")
        if number is None or not star:
            return line
        found = _DIGITS.match(given)
        said = found[0] if found else b""
        wanted = {1: checksum, 2: checksum, 3: checksum, 5: crc16}.get(len(said))
        if wanted is None or wanted(body) != int(said):
            return None
        self.last_number = int(number[1])
        return body


def _m92(board: MainLoop, command: Command) -> None:
    if command.values:
        HANDLERS["M92"](board, command)
        return
    x, y, z, e = (float(value) for value in board.machine.state["steps_per_mm"])
    board.machine.say(f"Steps/mm: X: {x:.3f}, Y: {y:.3f}, Z: {z:.3f}, E: {e:.3f}")


def _where(board: MainLoop) -> str:
    machine = board.machine
    at, shift = machine.modal["position"][0], machine.modal["shift"][0]
    x, y, z = (float(at[k] + shift[k]) + 0.0 for k in range(3))
    return f"X:{x:.3f} Y:{y:.3f} Z:{z:.3f} E:{float(at[3]) + 0.0:.3f}"


def _m114(board: MainLoop, command: Command) -> None:
    counts = " ".join(str(int(v)) for v in board.machine.planner["position"][0][:3])
    board.machine.say(f"{_where(board)} E0:0.0 Count {counts} Machine 0.000 0.000 0.000")


def _m115(board: MainLoop, command: Command) -> None:
    board.machine.say(
        "FIRMWARE_NAME: RepRapFirmware for Duet 3 MB6HC FIRMWARE_VERSION: 3.6.0 "
        "ELECTRONICS: Duet 3 MB6HC v1.02 or later FIRMWARE_DATE: 2025-04-01"
    )


def _listed(values: Any, factor: float = 1.0) -> str:
    return ", ".join(
        f"{axis}: {float(v) * factor:.1f}" for axis, v in zip("XYZE", values, strict=True)
    )


def _m201(board: MainLoop, command: Command) -> None:
    if command.values:
        HANDLERS["M201"](board, command)
        return
    board.machine.say(
        f"Accelerations (mm/sec^2): {_listed(board.machine.state['max_acceleration'])}"
    )


def _m203(board: MainLoop, command: Command) -> None:
    """In mm/min, where Marlin's is in mm/s."""
    if not command.values:
        speeds = _listed(board.machine.state["max_speed"], 60.0)
        board.machine.say(f"Max speeds (mm/min): {speeds}, min. speed 30.00")


def _m208(board: MainLoop, command: Command) -> None:
    modal = board.machine.modal
    spans = zip("XYZ", modal["low"][0], modal["high"][0], strict=True)
    words = ", ".join(f"{axis}{float(low):.1f}:{float(high):.1f}" for axis, low, high in spans)
    board.machine.say(f"Axis limits (mm)s {words}")


def g92_silent(board: MainLoop, command: Command) -> None:
    """As Marlin's, which reports the position too."""
    begin, now = len(board.machine.output), board.machine.now
    HANDLERS["G92"](board, command)
    del board.machine.output[begin:]
    board.machine.now = now


def _g92(board: MainLoop, command: Command) -> None:
    g92_silent(board, command)
    if isinstance(board, DuetPrinter):
        board.homed |= command.values.keys() & set("XYZ")


def _g28(board: MainLoop, command: Command) -> Steps:
    if isinstance(board, DuetPrinter):
        board.homed |= (command.flags | command.values.keys()) & set("XYZ") or set("XYZ")
    return HANDLERS["G28"](board, command)


class DuetPrinter(MarlinPrinter):
    """See the module; parameters as `sim.marlin.MarlinPrinter`'s."""

    handlers: ClassVar[Mapping[str, Handler]] = {
        **{name: handler for name, handler in HANDLERS.items() if name not in _MISSING},
        "G20": HANDLERS["G21"],
        "G28": _g28,
        "G92": _g92,
        "M85": HANDLERS["M107"],  # known, does nothing
        "M92": _m92,
        "M201": _m201,
        "M203": _m203,
        "M208": _m208,
        "M114": _m114,
        "M115": _m115,
    }
    too_cold_words: ClassVar[str] = (
        "Warning: Tool 0 was not driven because its heater temperatures were not high enough"
    )
    unhomed_words: ClassVar[str] = "Error: G0/G1: insufficient axes homed"
    banner: ClassVar[tuple[str, ...]] = ()
    offsets_by: ClassVar[str] = "G10"
    motors_run_on: ClassVar[bool] = False
    whole_percents: ClassVar[bool] = False

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        self.lines = DuetLines(self.machine.printer.max_line_bytes)
        self.machine.reports.keepalive_s = 0.0
        self.homed: set[str] = set()

    def reset(self) -> None:
        """Reset line or power button."""
        super().reset()
        self.machine.reports.keepalive_s = 0.0
        self.homed = set()

    def say_unknown(self, command: Command) -> None:
        """There is no such command."""
        self.machine.say(f"Warning: {command.name}: Command is not supported")

    def say_halted(self, reason: str) -> None:
        """It stops for good."""
        self.machine.say("Emergency Stop! Reset the controller to continue.")

    def take_tool(self, command: Command) -> Iterator[Wait]:
        """T: none with that number deselects all, and is no head here; T alone tells."""
        machine = self.machine
        if machine.printer.head_count == 1:
            return
        if command.number < 0:
            machine.say(f"Tool {machine.tool} is selected")
        elif command.number >= machine.printer.head_count:
            machine.say(f"Error: Tool {command.number} not found")
        else:
            yield from take_tool_in_silence(self, command.number)

    def _work(self, command: Command) -> Steps:
        moved = command.values.keys() & set("XYZ")
        if command.letter == "G" and command.number <= 3 and not moved <= self.homed:
            self.machine.say(self.unhomed_words)
            return None
        return super()._work(command)

    def _take_plain_moves(self, data: bytes) -> bytes:
        return data


PRINTER: Final = DuetPrinter
