"""A simulated Klipper: what it does otherwise than Marlin on the wire. Not verified.

Modelled, after its source (`klippy/gcode.py`, 2025): line numbers are skipped and checksums taken
off unchecked, so a garbled line is done as it came; an ``ok`` to each line; ``// Unknown
command``, ``!! ...`` before the ok of a command that fails; ``// Klipper state:`` Ready and
Shutdown; few commands (no M85, M92, M113, M302); no busy messages. Axes move only once they are
homed or SET_KINEMATIC_POSITION has said where they are; after the idle timeout (600 s) heaters and
motors are off and no axis is homed. SET_VELOCITY_LIMIT, SET_IDLE_TIMEOUT and SET_PRESSURE_ADVANCE
answer as theirs do, and change nothing but the timeout. SET_GCODE_OFFSET and G92 shift the places
that a job names, and SET_KINEMATIC_POSITION leaves such a shift as it is.

Not modelled: its motion (Marlin's planner runs here), macros and other named commands, that G-code
commands wait for room in seconds of motion, not in blocks.

After a shutdown each line is answered, an empty one as well, as a real one does (commit 84104bbb,
2026-11-22): by why it has stopped with ``//`` and ``!!``; M112 by an ``ok`` alone. (A real one also
still answers M105, M114 and M115.)
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import ClassVar, Final

import numpy as np

from sim.families.reprapfirmware.printer import DuetPrinter, g92_silent
from sim.gcode import Command, split_line
from sim.gcode_extended import Named, plain_command
from sim.gcode_modal import interpret
from sim.marlin_commands import HANDLERS, Handler
from sim.marlin_lines import LineReader
from sim.marlin_loop import MainLoop
from sim.marlin_machine import Still, Wait
from sim.marlin_waits import Steps

IDLE_S: Final = 600.0
"""Klipper's default; its timer counts motion, not words."""
_NAMED: Final = re.compile(rb"([A-Za-z]+_\w+)\s*(.*)")
_TIMEOUT: Final = re.compile(rb"TIMEOUT=([\d.]+)")
_VALUE: Final = re.compile(rb"\b([A-Z_]+)=([+-]?\d*\.?\d+)")
_NUMBER: Final = re.compile(rb"[Nn]\d+\s*")
_G: Final = (4, 21, 28, 90, 91)
_M: Final = (18, 82, 83, 84, *range(104, 108), *(109, 110, 112, 117, 118, 119, 140, 190, 204))
_STOPPED: Final = (
    "// Shutdown due to M112 command",
    "// Once the underlying issue is corrected, use the",
    '// "FIRMWARE_RESTART" command to reset the firmware, reload the',
    "// config, and restart the host software.",
    "// Printer is shutdown",
    "!! Shutdown due to M112 command",
)
_KNOWN: Final = tuple([f"G{n}" for n in _G] + [f"M{n}" for n in (*_M, 220, 221, 400)])


def _values(words: bytes) -> dict[str, float]:
    return {name.decode(): float(value) for name, value in _VALUE.findall(words.upper())}


def _parameters(words: bytes) -> dict[str, str]:
    pairs = (word.partition("=") for word in words.decode("ascii", "replace").split())
    return {key.upper(): value for key, _, value in pairs}


class KlipperLines(LineReader):
    """Takes everything."""

    def accept(self, line: bytes) -> bytes:
        """The command without number and checksum."""
        found = _NUMBER.match(line)
        self.last_number += 1
        return (line[found.end() :] if found else line).partition(b"*")[0]


def _g92(board: MainLoop, command: Command) -> None:
    """Without a word it counts every axis from 0, which Marlin doesn't."""
    if not command.values:
        split_line(b"G92 X0 Y0 Z0 E0", board.words)
    g92_silent(board, command)


def _g28(board: MainLoop, command: Command) -> Steps:
    if isinstance(board, KlipperPrinter):
        board.homed |= (command.flags | command.values.keys()) & set("XYZ") or set("XYZ")
    return HANDLERS["G28"](board, command)


def _m114(board: MainLoop, command: Command) -> None:
    machine = board.machine
    at, shift = machine.modal["position"][0], machine.modal["shift"][0]
    x, y, z = (float(at[k] + shift[k]) + 0.0 for k in range(3))
    machine.say(f"X:{x:.3f} Y:{y:.3f} Z:{z:.3f} E:{float(at[3]) + 0.0:.3f}")


def _m115(board: MainLoop, command: Command) -> None:
    board.say_ok(" FIRMWARE_NAME:Klipper FIRMWARE_VERSION:v0.13.0")


def _m84(board: MainLoop, command: Command) -> None:
    if isinstance(board, KlipperPrinter):
        board.homed = set()


def _limits(board: MainLoop) -> str:
    state = board.machine.state
    speed, acceleration = float(state["max_speed"][0]), float(state["acceleration"][0])
    return f"// max_velocity: {speed:.6f}\n// max_accel: {acceleration:.6f}"


class KlipperPrinter(DuetPrinter):
    """See the module; parameters as `sim.marlin.MarlinPrinter`'s.

    The heater's least temperature for extrusion is off, as bioprinters set it in printer.cfg.
    """

    handlers: ClassVar[Mapping[str, Handler]] = {
        **{name: HANDLERS[name] for name in _KNOWN},
        "G28": _g28,
        "G92": _g92,
        "M18": _m84,
        "M84": _m84,
        "M114": _m114,
        "M115": _m115,
    }
    too_cold_words: ClassVar[str] = "!! Extrude below minimum temp"
    unhomed_words: ClassVar[str] = "!! Must home axis first"
    banner: ClassVar[tuple[str, ...]] = ("// Klipper state: Ready",)

    def __init__(self, *given: object, **named: object) -> None:
        super().__init__(*given, **named)
        self.lines = KlipperLines(self.machine.printer.max_line_bytes)
        self.machine.cold_allowed = True
        self.machine.idle_limit_s = IDLE_S
        self._after_empty = False
        self._no_offsets()

    def reset(self) -> None:
        """FIRMWARE_RESTART, or power."""
        super().reset()
        self._no_offsets()
        self.machine.cold_allowed = True
        self.machine.idle_limit_s = IDLE_S

    def say_unknown(self, command: Command) -> None:
        """There is no such command."""
        self.machine.say(f'// Unknown command:"{command.name}"')

    def take_tool(self, command: Command) -> Iterator[Wait]:
        """T: no command of its own, but a configuration with one head may take it in silence."""
        if self.machine.printer.head_count > 1:
            self.say_unknown(command)
        return
        yield Still()

    def say_halted(self, reason: str) -> None:
        """It stops for good."""
        self.machine.say("// Klipper state: Shutdown")

    def kill(self, reason: str) -> None:
        """Stop for good; answer what waited, with the empty line that stood before an M112."""
        waiting = [b""] * self._after_empty + [line for line in self._queue if line != b"M112"]
        super().kill(reason)
        for line in waiting:
            self._answer_stopped(line)

    def hear_dead(self) -> None:
        """Answer each line."""
        *lines, rest = bytes(self.wire.ring).split(b"\n")
        self.wire.ring[:] = rest
        for line in lines:
            self._answer_stopped(line.strip())

    def _answer_stopped(self, line: bytes) -> None:
        for text in () if line == b"M112" else _STOPPED:
            self.machine.say(text)
        self.machine.say("ok")

    def _read_line(self) -> bool:
        ring = self.wire.ring
        if ring:
            halts = self._after_empty and ring.startswith(b"M112")
            self._after_empty = halts or ring.startswith(b"\n")
        return super()._read_line()

    def idle_is_over(self) -> None:
        """Heaters and motors go off: TURN_OFF_HEATERS, M84."""
        self.machine.heaters_off()
        self.machine.idle_since = math.inf
        self.homed = set()

    def _work(self, command: Command) -> Steps:
        named = _NAMED.match(self._command)
        if named is None:
            return super()._work(command)
        name = named[1].decode().upper()
        if name == "SET_KINEMATIC_POSITION":
            self._stand_at(_values(named[2]))
        elif name == "SET_IDLE_TIMEOUT":
            self._set_idle_timeout(named[2].upper())
        elif name == "SET_GCODE_OFFSET":
            self._set_offset(_values(named[2]))
        elif name == "ACTIVATE_EXTRUDER":
            return self._activate(named[2])
        elif name == "SET_VELOCITY_LIMIT":
            self.machine.say(_limits(self))
        elif name == "SET_PRESSURE_ADVANCE":
            self.machine.say("// pressure_advance: 0.000000")
        elif name == "TURN_OFF_HEATERS":
            self.machine.heaters_off()
        else:
            self.machine.say(f'// Unknown command:"{name}"')
        return None

    # What a job calls a place is the head's own place less all shifts; ``shift`` of the modal state
    # leads from the planner's count to the job's, ``_own`` from that count to the head's.

    def _no_offsets(self) -> None:
        self._own = self.machine.modal["shift"][0].copy()
        self._offset = np.zeros(3)

    def _stand_at(self, values: dict[str, float]) -> None:
        """SET_KINEMATIC_POSITION: the head is there; what G92 and offsets shift stays shifted."""
        modal = self.machine.modal[0]
        for axis, name in enumerate("XYZ"):
            if name in values:
                own = values[name] - modal["position"][axis]
                modal["shift"][axis] += own - self._own[axis]
                self._own[axis] = own
        self.homed |= set("XYZ")

    def _set_offset(self, values: dict[str, float]) -> None:
        """SET_GCODE_OFFSET without MOVE: what is named later lies so much farther."""
        for axis, name in enumerate("XYZ"):
            now = self._offset[axis]
            value = values.get(name, now + values.get(f"{name}_ADJUST", 0.0))
            self.machine.modal["shift"][0][axis] -= value - now
            self._offset[axis] = value

    def _activate(self, words: bytes) -> Iterator[Wait]:
        """ACTIVATE_EXTRUDER: its own count of E, which begins at 0; nothing moves."""
        machine = self.machine
        chosen = plain_command(Named(0, "ACTIVATE_EXTRUDER", _parameters(words)))
        number = int(chosen[1:]) if chosen[:1] == b"T" else machine.printer.head_count
        if number >= machine.printer.head_count:
            machine.say(f"!! The value '{words.decode()}' is not valid for EXTRUDER")
            return
        called = f"extruder{number or ''}"
        if number == machine.tool:
            machine.say(f"// Extruder {called} already active")
            return
        machine.say(f"// Activating extruder {called}")
        yield Still()
        split_line(chosen, self.words)
        interpret(machine.modal[0], self.words[0])
        machine.modal["plunger_shift"] += machine.modal["position"][0, 3]
        machine.modal["position"][0, 3] = 0.0
        machine.use_head(number)

    def _set_idle_timeout(self, words: bytes) -> None:
        given = _TIMEOUT.search(words)
        if given is not None:
            self.machine.idle_limit_s = float(given[1])
        self.machine.idle_since = self.machine.now  # theirs begins anew, too
        self.machine.say(f"// idle_timeout: Timeout set to {self.machine.idle_limit_s:.2f} s")


PRINTER: Final = KlipperPrinter
