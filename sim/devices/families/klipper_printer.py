"""Simulated printer with Klipper firmware: commands and replies, after the firmware's source."""

from __future__ import annotations

import math
import re
from typing import ClassVar, Final

import numpy as np

from gcode.program.gcode import Command, split_line
from gcode.program.modal import interpret
from gcode.reading.line import plain_command
from sim.devices.board.controller import Controller, Firmware, Handlers
from sim.devices.board.machine import STANDSTILL, Steps, Task
from sim.devices.board.motion import Motion
from sim.devices.board.printer import SimulatedPrinter, set_position
from sim.devices.board.wire import Numbering
from sim.devices.families.marlin_commands import HANDLERS
from sim.devices.families.marlin_printer import HomedFirmware
from sim.devices.families.marlin_reports import place_report, set_flow_percent, set_speed_percent

# Modelled, after its source (`klippy/gcode.py`, 2025): line numbers are skipped and checksums taken
# off unchecked, so a garbled line is done as it came; an ``ok`` to each line; ``// Unknown
# command``, ``!! ...`` before the ok of a command that fails; ``// Klipper state:`` Ready and
# Shutdown; few commands (no M85, M92, M113, M302); no busy messages. Axes move only once they are
# homed or SET_KINEMATIC_POSITION has given their place; after the idle timeout (600 s) heaters
# and motors are off and no axis is homed. SET_VELOCITY_LIMIT, SET_IDLE_TIMEOUT and
# SET_PRESSURE_ADVANCE answer as theirs do, and change nothing but the timeout. SET_GCODE_OFFSET and
# G92 shift the places that a job names, and SET_KINEMATIC_POSITION leaves such a shift as it is;
# GET_POSITION tells it.
#
# It has few of Marlin's codes, and what isn't listed here of those is done and answered by Marlin's
# own firmware part: this twin is one with other words and commands.
#
# Not modelled: its motion (Marlin's planner runs here), macros and other named commands, that
# G-code commands wait for room in seconds of motion, not in blocks.
#
# After a shutdown each line is answered, an empty one as well, as a real one does (commit 84104bbb,
# 2026-11-22): by why it has stopped with ``//`` and ``!!``; M112 by an ``ok`` alone. (A real one
# also still answers M105, M114 and M115.)
IDLE_S: Final = 600.0
"""Klipper's default; its timer counts motion, not words."""
_NAMED: Final = re.compile(rb"([A-Za-z]+_\w+)\s*(.*)")
_TIMEOUT: Final = re.compile(rb"TIMEOUT=([\d.]+)")
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


def _g92(board: Controller, command: Command) -> None:
    """Without a word it counts every axis from 0, which Marlin doesn't."""
    if not command.values:
        split_line(b"G92 X0 Y0 Z0 E0", board.words)
    set_position(board)


def _m114(board: Controller, command: Command) -> None:
    board.machine.say(place_report(board))


def _m115(board: Controller, command: Command) -> None:
    board.say_ok(" FIRMWARE_NAME:Klipper FIRMWARE_VERSION:v0.13.0")


def _limits(board: Controller) -> str:
    state = board.machine.motion.state
    speed, acceleration = float(state["max_speed"][0]), float(state["acceleration"][0])
    return f"// max_velocity: {speed:.6f}\n// max_accel: {acceleration:.6f}"


_NUMBER: Final = re.compile(rb"[Nn]\d+\s*")


class KlipperNumbering(Numbering):
    """Klipper's line numbering: accepts any line, and counts those taken."""

    def accept(self, line: bytes) -> bytes:
        """The command without number and checksum."""
        match = _NUMBER.match(line)
        self.last_number += 1
        return (line[match.end() :] if match else line).partition(b"*")[0]


class Klipper(HomedFirmware):
    """See the module.

    The heater's least temperature for extrusion is off, as bioprinters set it in printer.cfg.
    """

    numbering: ClassVar[type[Numbering]] = KlipperNumbering
    handlers: ClassVar[Handlers] = {
        **{name: HANDLERS[name] for name in _KNOWN},
        "G92": _g92,
        "M114": _m114,
        "M115": _m115,
        "M220": set_speed_percent,
        "M221": set_flow_percent,
    }
    offsets_by: ClassVar[str] = ""  # none: SET_GCODE_OFFSET is one for all heads
    too_cold_words: ClassVar[str] = "!! Extrude below minimum temp"
    not_homed_words: ClassVar[str] = "!! Must home axis first"
    banner: ClassVar[tuple[str, ...]] = ("// Klipper state: Ready",)

    def __init__(self, board: Controller) -> None:
        super().__init__(board)
        self._offsets = Offsets(board.machine.motion)
        self._after_empty = False

    def power_up(self) -> None:
        """FIRMWARE_RESTART, or power."""
        super().power_up()
        machine = self.board.machine
        machine.heat.cold_allowed = True
        machine.idle_limit_s = IDLE_S
        self._offsets = Offsets(machine.motion)

    # -- lines

    def look_at(self, ring: bytearray) -> None:
        """Note whether an empty line stands before what comes next."""
        if ring:
            halts = self._after_empty and ring.startswith(b"M112")
            self._after_empty = halts or ring.startswith(b"\n")

    # -- commands

    def start(self, command: Command) -> Steps:
        """Begin a command, by letter and number or by its name."""
        named = _NAMED.match(self.board.work.line)
        if named is not None:
            return self._start_named(named[1].decode().upper(), named[2])
        if command.name in ("M18", "M84"):
            self.placed.clear()
        return super().start(command)

    def _start_named(self, name: str, words: bytes) -> Steps:
        machine = self.board.machine
        if name == "SET_KINEMATIC_POSITION":
            self._offsets.stand_at(values_of(words))
            self.placed |= {"X", "Y", "Z"}
        elif name == "SET_IDLE_TIMEOUT":
            self._set_idle_timeout(words.upper())
        elif name == "SET_GCODE_OFFSET":
            self._offsets.set(values_of(words))
        elif name == "ACTIVATE_EXTRUDER":
            return self._activate(words)
        elif name == "GET_POSITION":
            machine.say(self._offsets.position_report())
        elif name == "SET_VELOCITY_LIMIT":
            machine.say(_limits(self.board))
        elif name == "SET_PRESSURE_ADVANCE":
            machine.say("// pressure_advance: 0.000000")
        elif name == "TURN_OFF_HEATERS":
            machine.heat.off(machine.now)
        elif name not in (
            "SET_FAN_SPEED",
            "SET_PIN",
            *map(str.upper, machine.printer.extra_commands),
        ):
            # Nothing here hangs on outputs.
            machine.say(f'// Unknown command:"{name}"')
        return None

    def _activate(self, words: bytes) -> Task:
        """ACTIVATE_EXTRUDER: its own count of E, which begins at 0; nothing moves."""
        machine, motion = self.board.machine, self.board.machine.motion
        chosen = plain_command("ACTIVATE_EXTRUDER", parameters_of(words))
        number = int(chosen[1:]) if chosen[:1] == b"T" else machine.printer.tool_count
        if number >= machine.printer.tool_count:
            machine.say(f"!! The value '{words.decode()}' is not valid for EXTRUDER")
            return
        called = f"extruder{number or ''}"
        if number == motion.tool:
            machine.say(f"// Extruder {called} already active")
            return
        machine.say(f"// Activating extruder {called}")
        yield STANDSTILL
        split_line(chosen, self.board.words)
        interpret(motion.modal[0], self.board.words[0])
        motion.modal["plunger_shift"] += motion.modal["position"][0, 3]
        motion.modal["position"][0, 3] = 0.0
        machine.motion.use_head(number, machine.now)

    def _set_idle_timeout(self, words: bytes) -> None:
        machine = self.board.machine
        given = _TIMEOUT.search(words)
        if given is not None:
            machine.idle_limit_s = float(given[1])
        machine.idle_since = machine.now  # theirs begins anew, too
        machine.say(f"// idle_timeout: Timeout set to {machine.idle_limit_s:.2f} s")

    def take_tool(self, command: Command) -> Steps:
        """T: no command of its own, but a configuration with one head may take it in silence."""
        if self.board.machine.printer.tool_count > 1:
            self.say_unknown(command)
        return None

    def say_unknown(self, command: Command) -> None:
        """There is no such command."""
        self.board.machine.say(f'// Unknown command:"{command.name}"')

    # -- ends

    def idle_is_over(self) -> None:
        """Heaters and motors go off: TURN_OFF_HEATERS, M84."""
        self.board.machine.heat.off(self.board.machine.now)
        self.board.machine.idle_since = math.inf
        self.placed.clear()

    def say_halted(self, reason: str) -> None:
        """It stops for good."""
        self.board.machine.say("// Klipper state: Shutdown")

    def answer_unserved(self, waiting: list[bytes]) -> None:
        """Answer what waited, with the empty line that stood before an M112."""
        for line in [b""] * self._after_empty + [line for line in waiting if line != b"M112"]:
            self._answer_stopped(line)

    def hear_dead(self) -> None:
        """Answer each line."""
        ring = self.board.wire.ring
        *lines, rest = bytes(ring).split(b"\n")
        ring[:] = rest
        for line in lines:
            self._answer_stopped(line.strip())

    def _answer_stopped(self, line: bytes) -> None:
        for text in () if line == b"M112" else _STOPPED:
            self.board.machine.say(text)
        self.board.machine.say("ok")


class KlipperPrinter(SimulatedPrinter):
    """A board with Klipper; see the module."""

    firmware_class: ClassVar[type[Firmware]] = Klipper


PRINTER: Final = KlipperPrinter


class Offsets:
    """Coordinate offsets by SET_KINEMATIC_POSITION and SET_GCODE_OFFSET.

    What a job calls a place is the head's own place less all shifts. ``shift`` of the modal state
    leads from the planner's count to the job's, and `Offsets` keeps what leads from that count to
    the head's.
    """

    def __init__(self, motion: Motion) -> None:
        self._motion = motion
        self._own = motion.modal["shift"][0].copy()
        self._offset = np.zeros(3)

    def stand_at(self, values: dict[str, float]) -> None:
        """Say where the head is; what G92 and offsets shift stays shifted."""
        modal = self._motion.modal[0]
        for axis, name in enumerate("XYZ"):
            if name in values:
                own = values[name] - modal["position"][axis]
                modal["shift"][axis] += own - self._own[axis]
                self._own[axis] = own

    def set(self, values: dict[str, float]) -> None:
        """Set an offset without MOVE: what is named later lies so much farther."""
        for axis, name in enumerate("XYZ"):
            now = self._offset[axis]
            value = values.get(name, now + values.get(f"{name}_ADJUST", 0.0))
            self._motion.modal["shift"][0][axis] -= value - now
            self._offset[axis] = value

    def position_report(self) -> str:
        """Say where the head is, and what a job's places are shifted by (GET_POSITION)."""
        modal = self._motion.modal[0]
        head = modal["position"][:3] + self._own
        e, pushed = float(modal["position"][3]), 0.01 * float(modal["flow_percent"])
        plunger = e + float(modal["plunger_shift"])
        named = {
            "toolhead": (head, plunger),
            "gcode": (head, plunger),
            "gcode base": (self._own - modal["shift"], plunger - pushed * e),
        }
        per_mm = self._motion.state["steps_per_mm"][:3]
        motors = zip("xyz", modal["position"][:3], head, per_mm, strict=True)
        steps, places = "", ""
        for axis, mm, at_mm, per_mm in motors:
            steps += f" stepper_{axis}:{round(mm * per_mm)}"
            places += f" stepper_{axis}:{at_mm:.6f}"
        return f"// mcu:{steps}\n// stepper:{places}\n" + "\n".join(
            f"// {name}: X:{x:.6f} Y:{y:.6f} Z:{z:.6f} E:{at:.6f}"
            for name, (x, y, z), at in ((name, mm.tolist(), at) for name, (mm, at) in named.items())
        )


_VALUE: Final = re.compile(rb"\b([A-Z_]+)=([+-]?\d*\.?\d+)")


def values_of(words: bytes) -> dict[str, float]:
    """Read numbers by their names."""
    return {name.decode(): float(value) for name, value in _VALUE.findall(words.upper())}


def parameters_of(words: bytes) -> dict[str, str]:
    """Read words by their names, in capitals."""
    pairs = (word.partition("=") for word in words.decode("ascii", "replace").split())
    return {key.upper(): value for key, _, value in pairs}
