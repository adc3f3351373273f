"""Simulated printer class: the generic board with Marlin 2.1 firmware.

Modelled, after the transcripts recorded from a real Marlin (`tests/sim/data/marlin`), besides what
any board has (`sim.devices.board.printer`):

- line numbers and checksums: errors, ``Resend`` with its trailing ``ok`` and the flush in
  mid-line, repeated lines dropped without an answer;
- busy messages, reports of temperature and position, dwells, waits for heat and for the user,
  cold extrusion, M85, M112, M410, M108 with and without emergency parser, ADVANCED_OK, stored
  settings, reset, and kill: silence until a reset, and motors that run on for a while.

Not modelled: tuning of the heaters (M303), the EEPROM's image (stored settings outlast a reset,
their CRC is always the same).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from gcode.motion.planner import add_move, command_time, next_event, run_until
from gcode.motion.state import Record, Records
from gcode.program.gcode import Command
from gcode.program.modal import has_word, interpret, number_at, speed, split_words
from kernels import jit
from sim.devices.board.controller import Controller, Firmware, Handlers
from sim.devices.board.machine import (
    FREE_SLOT,
    STANDSTILL,
    HeatFault,
    Machine,
    Steps,
    Task,
    Wait,
)
from sim.devices.board.printer import SimulatedPrinter, move
from sim.devices.board.wire import Numbering
from sim.devices.families.marlin_commands import HANDLERS, m420
from sim.devices.families.marlin_reports import (
    BANNER,
    EMERGENCY,
    MarlinNumbering,
    planned_position,
    quickstop,
    request_resend,
    temperatures,
)

# It does what the general path (`sim.devices.board.printer`) does, for the one case that makes up a
# print: the board waits for a line, the line is whole, numbered as expected, its checksum is good,
# it is a straight move and the planner has a place, now or when the next block ends. Anything else
# is left untouched to the general path.
NOT_TAKEN: Final = -1.0
_N, _STAR, _G, _SEMICOLON, _EOL = ord("N"), ord("*"), ord("G"), ord(";"), 10
_E_LETTER = 4


@jit
def is_sound_move(line: bytes, expected: int, longest: int, row: Record) -> bool:
    r"""Whether a line is whole, numbered as expected, sound by its checksum, and G0 or G1.

    Parameters
    ----------
    line, expected, longest
        As in `take_numbered_move`.
    row : record of `gcode.program.modal.WORDS`
        Gets the line's words where it comes to that.
    """
    size = len(line) - 1
    if size < 6 or size > longest or line[0] != _N or line[size] != _EOL:
        return False
    star = size - 1
    while star > 0 and line[star] != _STAR:
        star -= 1
    given, after = number_at(line, star + 1, size)
    if star == 0 or after != size:
        return False
    xor = 0
    for i in range(star):
        if line[i] == _SEMICOLON or line[i] == _EOL:
            return False
        xor ^= line[i]
    split_words(line, 0, size, row)
    if int(given) != xor or row.numbered != expected:
        return False
    return row.letter == _G and 0 <= row.number <= 1


@jit
def take_numbered_move(
    line: bytes,
    expected: int,
    longest: int,
    cold: bool,
    modal: Records,
    words: Records,
    planner: Records,
    ring: Records,
    log: Records,
    now: float,
    alarm: float,
    job_line: int,
    costs: NDArray[np.float64],
) -> float:
    r"""Take a line if it is the plain next move.

    Parameters
    ----------
    line : bytes
        With its ``\n``.
    expected : int
        The next line number.
    longest : int
        Bytes that the firmware keeps of a line.
    cold : bool
        Whether the plunger may not move.
    modal, words, planner, ring, log : records
        State of the firmware.
    now : float, s
        When the line's last byte arrived.
    alarm : float, s
        Nothing else may happen before this time; a wait beyond it isn't for this road.
    job_line : int
        Kept with the block.
    costs : (5,) float64
        Of the processor, see `gcode.motion.planner.command_time`.

    Returns
    -------
    float
        When the move was taken, s; `NOT_TAKEN` where nothing was done.
    """
    row = words[0]
    if planner[0].logged + 2 * len(ring) > len(log):
        return NOT_TAKEN
    if not is_sound_move(line, expected, longest, row) or (cold and has_word(row, _E_LETTER)):
        return NOT_TAKEN
    run_until(planner, ring, log, now)
    now += command_time(planner, ring, now, costs)
    run_until(planner, ring, log, now)
    if planner[0].count >= len(ring) - 1:
        free = max(now, next_event(planner))
        if free > alarm:
            return NOT_TAKEN
        now = free
        run_until(planner, ring, log, now)
    if now > alarm:
        return NOT_TAKEN
    interpret(modal[0], row)
    add_move(planner, ring, modal[0].position, speed(modal[0]), job_line, now)
    return now


def take_plain_moves(board: Controller, data: bytes, alarm: Callable[[], float]) -> bytes:
    """Take the plain moves at the front of ``data``; return what is left.

    Parameters
    ----------
    alarm : callable
        When the main loop next has something to do of its own, s.
    """
    wire, machine = board.wire, board.machine
    if machine.dead or machine.settings.has_least_feeds or machine.motion.slope:
        return data
    if not board.work.idle or len(data) > wire.capacity:
        return data
    if not wire.quiet or not board.reader.empty or board.plan.counts_bytes:
        return data
    arrived = wire.occupied_until(machine.now)
    while data:
        end = data.find(b"\n") + 1
        line = data if end == len(data) else data[:end]
        arrived += end * wire.byte_s
        if end == 0 or not _take(board, line, max(arrived, machine.now), alarm):
            return data
        data = data[end:]
    return data


def _take(board: Controller, line: bytes, arrived: float, alarm: Callable[[], float]) -> bool:
    """Take one line, whose last byte arrived at ``arrived``, s; whether it was a plain move."""
    machine = board.machine
    motion, printer = machine.motion, machine.printer
    expected = board.lines.last_number + 1
    if board.plan.has_line(expected) or arrived < motion.closed_until:
        return False
    taken = take_numbered_move(
        line,
        expected,
        printer.max_line_bytes - 1,
        machine.heat.too_cold(machine.now) or machine.dry,
        motion.modal,
        board.words,
        motion.planner,
        motion.ring,
        motion.log,
        arrived,
        min(alarm(), arrived + (machine.reports.keepalive_s or math.inf)),
        expected - 1 if board.job is None else board.job.find(line),
        motion.costs,
    )
    if taken == NOT_TAKEN:
        return False
    if board.job is not None:
        board.job.take(line)
    machine.now = machine.idle_since = taken
    board.lines.last_number = expected
    if printer.advanced_ok:
        board.work.line = line
    board.say_ok(board.firmware.ok_words())
    return True


_URGENT: Final = (b"M112", b"M410", b"M108")
_NUMBER_WORD: Final = re.compile(rb"N[-0-9]*")
_HEAT_WORDS = {
    HeatFault.SENSOR: ("MINTEMP triggered", "Err: MINTEMP"),
    HeatFault.RUNAWAY: ("Thermal Runaway", "THERMAL RUNAWAY"),
}


class Marlin(Firmware):
    """See the module and `sim.devices.board.controller.Firmware`.

    Attributes
    ----------
    handlers : mapping of str to function
        Commands that it knows.
    offsets_by : str
        The command that tells offsets of heads.
    """

    numbering: ClassVar[type[Numbering]] = MarlinNumbering
    handlers: ClassVar[Handlers] = HANDLERS
    offsets_by: ClassVar[str] = "M218"
    banner: ClassVar[tuple[str, ...]] = BANNER
    too_cold_words: ClassVar[str] = "echo: cold extrusion prevented"
    too_long_words: ClassVar[str] = "echo: too long extrusion prevented"
    bad_arc_words: ClassVar[str] = "Error:G2/G3 bad parameters"
    runs_on: ClassVar[bool] = True

    # -- lines

    def urgent_pattern(self) -> re.Pattern[bytes] | None:
        """The emergency parser's, where the profile says that there is one."""
        return EMERGENCY if self.board.machine.printer.emergency_parser else None

    def refuse(self, reason: bytes) -> None:
        """Tell why, and ask for the line again."""
        last = self.board.lines.last_number
        self.board.machine.say(f"Error:{reason.decode()}, Last Line: {last}")
        request_resend(self.board)

    def urgent_code(self, line: bytes) -> bytes | None:
        """M112, M410 and M108 act when they enter the queue, but for an emergency parser."""
        on_arrival = self.board.machine.printer.emergency_parser
        return None if on_arrival or line[:4] not in _URGENT else line[1:4]

    def act_urgently(self, code: bytes) -> Steps:
        """Kill (M112), end a wait (M108), or drop all moves (M410)."""
        machine = self.board.machine
        if code == b"112":
            self.board.kill("M112 Shutdown")
        elif code == b"108":
            machine.waits_for_user = False
            machine.heat.awaited = False
        else:
            return quickstop(self.board)
        return None

    # -- commands

    def take_at_once(self, data: bytes, alarm: Callable[[], float]) -> bytes:
        """Take the plain next lines of a print."""
        return take_plain_moves(self.board, data, alarm)

    def start(self, command: Command) -> Steps:
        """Begin a command; an unknown one is reported."""
        printer = self.board.machine.printer
        if command.letter == "G" and command.number <= 3:
            return move(self.board)
        if command.letter == "T":
            return self.take_tool(command)
        name = f"{command.letter}{command.number}"
        if name in self.handlers:
            return self.handlers[name](self.board, command)
        if name == "M420" and self.board.machine.board.bed_slope:
            return m420(self.board, command)
        if name == self.offsets_by and printer.tool_count > 1:
            m218(self.board, command)
        elif name not in printer.extra_commands:
            self.say_unknown(command)
        return None

    def take_tool(self, command: Command) -> Steps:
        """T: another head."""
        return take_tool(self.board, command)

    def say_unknown(self, command: Command) -> None:
        """There is no such command."""
        self.board.machine.say(b'echo:Unknown command: "' + command.text + b'"')

    def echo(self, line: bytes) -> None:
        """Say the line that begins, after M111 S1."""
        if self.board.machine.debug & 1:
            self.board.machine.say("echo:" + line.decode("latin-1"), b"\r\n")

    def ok_words(self) -> str:
        """With ADVANCED_OK line number, free planner blocks and places in line."""
        machine, work = self.board.machine, self.board.work
        if not machine.printer.advanced_ok:
            return ""
        word = _NUMBER_WORD.match(work.line)
        number = f" {word[0].decode()}" if word else ""
        blocks = len(machine.motion.ring) - 1 - machine.motion.blocks
        return f"{number} P{blocks} B{machine.printer.command_queue - max(len(work.queue), 1)}"

    # -- reports by the clock

    def say_busy(self, wait: Wait) -> None:
        """The keepalive."""
        self.board.machine.say(f"echo:busy: {'paused for user' if wait.for_user else 'processing'}")

    def report_temperatures(self) -> None:
        """Report at M155's interval."""
        self.board.machine.say(temperatures(self.board.machine))

    def report_position(self) -> None:
        """Report at M154's interval."""
        self.board.machine.say(planned_position(self.board))

    # -- ends

    def idle_is_over(self) -> None:
        """Kill itself (M85)."""
        self.board.machine.say(
            "Error:!! KILL caused by too much inactive time - current command: "
            + self.board.work.line.decode("latin-1")
        )
        self.board.kill("KILLED.")

    def fail_heat(self, fault: HeatFault) -> None:
        """Tell a heater's fault, and kill itself."""
        error, reason = _HEAT_WORDS[fault]
        self.board.machine.say(f"Error:{error}, system stopped! Heater_ID: E0")
        self.board.kill(reason)

    def say_halted(self, reason: str) -> None:
        """It stops for good."""
        self.board.machine.say(f"echo:{reason}")
        self.board.machine.say("Error:Printer halted. kill() called!")
        self.board.machine.say("//action:poweroff")

    def halt_time(self) -> Callable[[], float]:
        """For as long as it waits for its words to get out; each step event puts it off."""
        machine = self.board.machine
        begin_s, before = machine.now, machine.motion.events(machine.now)

        def ends_s() -> float:
            done = machine.motion.events(machine.now) - before
            return begin_s + _HALT_S + _HALT_PER_EVENT_S * done

        return ends_s

    def hear_dead(self) -> None:
        """Take what comes after a halt: nothing is heard."""
        self.board.wire.flush()


class MarlinPrinter(SimulatedPrinter):
    """A board with Marlin; see the module."""

    firmware_class: ClassVar[type[Firmware]] = Marlin


PRINTER: Final = MarlinPrinter
_PLACED_BY: Final = frozenset("XYZ")


class HomedFirmware(Marlin):
    """Marlin's part where axes move only once they were homed or given a place.

    It says nothing of being busy, and takes each line through the main loop.

    Attributes
    ----------
    not_homed_words : str
        Said to a move of an axis without a place.
    placed : set of str
        Axes that have one.
    """

    not_homed_words: ClassVar[str]
    runs_on: ClassVar[bool] = False

    def __init__(self, board: Controller) -> None:
        super().__init__(board)
        self.placed: set[str] = set()

    def power_up(self) -> None:
        """Say nothing of being busy; no axis has a place."""
        self.board.machine.reports.keepalive_s = 0.0
        self.placed.clear()

    def take_at_once(self, data: bytes, alarm: Callable[[], float]) -> bytes:
        """Take nothing."""
        return data

    def start(self, command: Command) -> Steps:
        """Begin a command; a move of an axis without a place is an error."""
        given = command.values.keys() & _PLACED_BY
        if command.letter == "G" and command.number <= 3 and not given <= self.placed:
            self.board.machine.say(self.not_homed_words)
            return None
        if command.name == "G28":
            self.placed |= (command.flags | given) & _PLACED_BY or _PLACED_BY
        return super().start(command)


# The wait is counted in the main thread's own time, and the step interrupts are still on: what the
# planner holds is made meanwhile, and each step event makes the wait longer. Measured on
# bugfix-2.1.x of 2024-10-11 on an ATmega2560 (simavr, 2026-11-22), from M112's last byte to the
# last step: 0.638 s at 566 step events/s, 0.715 s at 2825, 0.843 s at 5634, 1.27 s at 10,680; with
# and without emergency parser alike. That is 0.613 s and 47.5 µs for each event. Then interrupts go
# off.
_HALT_S: Final = 0.613
"""From the firmware's last word to the halt, with no motor running."""
_HALT_PER_EVENT_S: Final = 47.5e-6
"""More for each step event within it."""


# The motors stand first. The place gets another name, by the difference of the two heads' offsets;
# where all axes are homed and S1 wasn't given, the carriage then goes so that the new tip is where
# the old one was. E goes on counting where it is, and moves the new head's plunger. The reply names
# the head in use, whether it is another or not. Not modelled: the small lift and the parking that a
# build may do besides, on a homed machine without S1.
_BACK_MM_S: Final = 300.0


def take_tool(board: Controller, command: Command) -> Task:
    """T: another head, the same again, or none such."""
    machine, number = board.machine, command.number
    count = machine.printer.tool_count
    if count == 1:  # the recorded build takes any number in silence, and goes on with its one
        return
    yield STANDSTILL
    if not 0 <= number < count:
        machine.say(f"echo:T{number} Invalid extruder")
        return
    begin = machine.motion.modal["position"][0].copy()
    shift = machine.motion.tool_offset[number] - machine.motion.tool_offset[machine.motion.tool]
    interpret(machine.motion.modal[0], board.words[0])
    machine.motion.use_head(number, machine.now)
    _rename(machine, begin[:3] + shift)
    if shift.any() and all(machine.homed) and command.values.get("S", 0.0) == 0:
        yield FREE_SLOT
        machine.motion.modal["position"] = begin
        machine.move_to(begin, _BACK_MM_S, -1)
        yield STANDSTILL
    machine.say(f"echo:Active Extruder: {number}")


def _rename(machine: Machine, place_mm: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
    if (machine.motion.modal["position"][0, :3] != place_mm).any():
        for axis in range(3):
            machine.motion.stand_at(axis, float(place_mm[axis]))


def m218(board: Controller, command: Command) -> None:
    """Offset of a head's tip from the first one's (a Duet's: G10 P); without words, tell them."""
    machine = board.machine
    number = int(command.values.get("P" if command.letter == "G" else "T", machine.motion.tool))
    if not 0 <= number < machine.printer.tool_count:
        machine.say(f"echo:M218 Invalid extruder {number}")
        return
    for axis, name in enumerate("XYZ"):
        if name in command.values:
            machine.motion.tool_offset[number, axis] = command.values[name]
    if not command.values:
        for one in range(1, machine.printer.tool_count):
            x, y, z = machine.motion.tool_offset[one]
            machine.say(f"  M218 T{one} X{x:.2f} Y{y:.2f} Z{z:.3f}")
