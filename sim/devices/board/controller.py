"""Controller board of a simulated printer: assembles its parts; reset and emergency stop."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Protocol

import numpy as np

from firmware_profiles import Printer
from gcode.motion.state import Board
from gcode.program.gcode import Command
from gcode.program.modal import WORDS
from sim.devices.board.machine import HeatFault, Machine, Steps, Task, Wait
from sim.devices.board.wire import BITS_PER_BYTE, LineReader, Numbering, Wire
from sim.devices.faults import Fault, FaultyCable, Gauge, Pace


class Firmware(Protocol):
    """A family's own part; it is made for one board and knows that board.

    Attributes
    ----------
    numbering : type of Numbering
        Reads line numbers and checksums.
    banner : tuple of str
        Said after a reset.
    too_cold_words, too_long_words : str
        Said where the plunger's part of a move is dropped.
    bad_arc_words : str
        Said to an arc that can't be made.
    runs_on : bool
        Whether the motors run on for a while after a kill.
    """

    board: Controller
    numbering: ClassVar[type[Numbering]]
    banner: ClassVar[tuple[str, ...]]
    too_cold_words: ClassVar[str]
    too_long_words: ClassVar[str]
    bad_arc_words: ClassVar[str]
    runs_on: ClassVar[bool]

    def __init__(self, board: Controller) -> None:
        self.board = board

    # -- lines

    def urgent_pattern(self) -> re.Pattern[bytes] | None:
        """Begin of a line that acts as its bytes arrive; None where none does."""

    def look_at(self, ring: bytearray) -> None:
        """Look at the received bytes before the next line is cut from them."""
        return

    def refuse(self, reason: bytes) -> None:
        """Tell that a line wasn't taken, and what to do about it."""

    def urgent_code(self, line: bytes) -> bytes | None:
        """Code of a line that acts as it enters the queue."""

    def act_urgently(self, code: bytes) -> Steps:
        """Do what an urgent code asks for."""

    # -- commands

    def take_at_once(self, data: bytes, alarm: Callable[[], float]) -> bytes:
        """Take what needs no main loop from the front of ``data``; return what is left.

        ``alarm`` tells when the main loop next has something to do of its own, s.
        """
        return data

    def start(self, command: Command) -> Steps:
        """Begin a command."""

    def echo(self, line: bytes) -> None:
        """Echo the line that begins, where the firmware was set to."""

    def ok_words(self) -> str:
        """Words behind the present command's ok."""

    # -- reports by the clock

    def say_busy(self, wait: Wait) -> None:
        """Tell that a command is under way."""

    def report_temperatures(self) -> None:
        """Tell the temperatures unasked."""

    def report_position(self) -> None:
        """Tell the position unasked."""

    # -- ends

    def power_up(self) -> None:
        """Set what this firmware begins with, after the board has forgotten everything."""
        return

    def idle_is_over(self) -> None:
        """Act where nothing has moved for longer than the firmware's idle limit."""

    def fail_heat(self, fault: HeatFault) -> None:
        """Tell a heater's fault, and stop for good."""

    def say_halted(self, reason: str) -> None:
        """Tell that it stops for good."""

    def halt_time(self) -> Callable[[], float]:
        """When motors that run on after a kill stop, s, by what is known at each call."""

    def answer_unserved(self, waiting: list[bytes]) -> None:
        """Answer the lines that waited when it was killed, if it does."""
        return

    def hear_dead(self) -> None:
        """Take what comes after a halt."""


class Job(Protocol):
    """A file that is printed (`sim.devices.serving.job_lines.JobLines`)."""

    def find(self, line: bytes) -> int:
        """Place in the file of a line; -1 for a host's own."""

    def take(self, line: bytes) -> int:
        """The same, of a line that is done now."""


class Controller:
    """The board, made of parts; commands of a firmware get it as their first argument.

    Parameters
    ----------
    printer : Printer
        The profile: steps, limits, buffers, baud rate, parser.
    start_mm : tuple, mm
        Where the tip stands at power-up. The firmware believes it too, at power-up and after
        every reset (a real one believes 0, 0, 0).
    board : Board
        The processor's speed, and whether thermistors are wired.
    faults : tuple of Fault
        What goes wrong, and when.

    Attributes
    ----------
    firmware : Firmware
        The family's own part, of `firmware_class`.
    machine : Machine
        Clock, motors, heaters.
    wire : Wire
        Bytes in flight and the receive ring.
    reader, lines : LineReader, Numbering
        What cuts lines, and what decides about their numbers.
    words : (1,) of `gcode.program.modal.WORDS`
        Of the command in hand.
    work : BoardWork
        Commands in line and in hand.
    unplugged : bool
        Set by a fault; whoever owns the port closes it.
    back_after_s : float or None
        After how long it is plugged in again; None for never.
    bad_line : FaultyCable
        The cable, for whoever owns the port.
    pace : Pace
        The board's clock against the host's, for whoever owns the port.
    job : Job or None
        The file that is printed, if it is known: it tells its commands from a host's own lines.
    gauges : dict of str to Gauge
        Sensors that it tells of, by the command that asks; what no real board of ours has.
    synced : int
        How often the host has had the motors waited for (M400); a good moment to keep a record.
    """

    firmware_class: ClassVar[type[Firmware]]

    def __init__(
        self,
        printer: Printer,
        start_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
        board: Board = Board(),  # noqa: B008
        faults: tuple[Fault, ...] = (),
    ) -> None:
        self.machine = Machine(printer, start_mm, board, BITS_PER_BYTE / printer.baud)
        self.firmware = self.firmware_class(self)
        urgent = self.firmware.urgent_pattern()
        self.wire = Wire(printer.baud, printer.receive_buffer_bytes, urgent)
        self.reader = LineReader(printer.max_line_bytes)
        self.lines: Numbering = self.firmware.numbering()
        self.words = np.zeros(1, WORDS)
        self.work = BoardWork()
        self.plan = FaultPlan(faults)
        self.unplugged = False
        self.back_after_s: float | None = None
        self.bad_line = FaultyCable()
        self.pace = Pace()
        self.job: Job | None = None
        self.gauges: dict[str, Gauge] = {}
        self.synced = 0
        self.firmware.power_up()

    def reset(self) -> None:
        """Reset line or power button: everything is forgotten, motors stop, the banner comes."""
        self.machine.motion.stop(self.machine.now)
        self._forget()
        self.reader.clear()
        self.lines.clear()
        self.machine.power_up()
        self.firmware.power_up()
        for line in self.firmware.banner:
            self.machine.say(line)

    def kill(self, reason: str) -> None:
        """Heaters off, fall silent, and halt: the motors at once, or after the firmware's wait."""
        waiting = list(self.work.queue)
        if not self.firmware.runs_on:
            self.machine.motion.stop(self.machine.now)
        self.machine.heat.off(self.machine.now)
        self.firmware.say_halted(reason)
        self._forget()
        self.machine.dead = True
        self.machine.halts_s = self.firmware.halt_time() if self.firmware.runs_on else None
        self.firmware.answer_unserved(waiting)

    def _forget(self) -> None:
        self.work.forget()
        self.wire.clear()
        self.plan.muted.clear()

    @property
    def halted(self) -> bool:
        """Whether the firmware is killed and the motors stand."""
        return self.machine.dead and self.machine.halts_s is None

    def say_ok(self, rest: str = "") -> None:
        """Answer the present command; no other ok will follow."""
        self.work.answered = True
        if self.work.mute:
            self.work.mute = False
        else:
            self.machine.say("ok" + rest)

    def hold_busy(self) -> None:
        """Say nothing of being busy until the present command is done."""
        self.work.busy_at = math.inf


Handler = Callable[[Controller, Command], Steps]
"""What a command does."""
Handlers = Mapping[str, Handler]
"""By letter and number."""


@dataclass
class BoardWork:
    """See the module.

    Attributes
    ----------
    queue : deque of bytes
        Lines that were taken; the first is in hand where there are tasks.
    tasks : list of (Task, Wait, bool)
        What is waited for, the newest last, and whether its end answers the command in hand.
    line : bytes
        The command in hand, or the last one.
    job_line : int
        Its place in the file that is printed; -1 for a host's own.
    answered : bool
        Whether it has its ok.
    mute : bool
        Whether the next ok is lost.
    busy_at : float, s
        When the firmware next says that it is busy.
    """

    queue: deque[bytes] = field(default_factory=deque)
    tasks: list[tuple[Task, Wait, bool]] = field(default_factory=list)
    line: bytes = b""
    job_line: int = -1
    answered: bool = False
    mute: bool = False
    busy_at: float = math.inf

    @property
    def idle(self) -> bool:
        """Whether no command is in line or in hand."""
        return not self.tasks and not self.queue

    def forget(self) -> None:
        """Drop everything, as a reset or a kill does."""
        self.queue.clear()
        self.tasks.clear()
        self.mute = False
        self.busy_at = math.inf


class FaultPlan:
    """Faults that are still to come; each comes once.

    Attributes
    ----------
    next_s : float, s
        When the next one by the clock is due; infinite for none.
    muted : set of int
        Lines whose ok will be lost.
    """

    def __init__(self, faults: Iterable[Fault] = ()) -> None:
        every = list(faults)
        self.muted: set[int] = set()
        self._by_line = {fault.line: fault for fault in every if fault.line is not None}
        timed = [(fault.time_s, fault) for fault in every if fault.time_s is not None]
        self._by_time = sorted(timed, key=lambda one: one[0], reverse=True)
        counted = [(fault.bytes, fault) for fault in every if fault.bytes is not None]
        self._by_bytes = sorted(counted, key=lambda one: one[0], reverse=True)

    @property
    def next_s(self) -> float:
        """See the class."""
        return self._by_time[-1][0] if self._by_time else math.inf

    @property
    def counts_bytes(self) -> bool:
        """Whether one waits for a number of bytes."""
        return bool(self._by_bytes)

    def has_line(self, number: int) -> bool:
        """Whether one waits for this line."""
        return number in self._by_line

    def at_line(self, number: int) -> Fault | None:
        """The one that waits for this line."""
        return self._by_line.pop(number, None)

    def is_mute(self, number: int | None) -> bool:
        """Whether a line's ok is to be lost; it is lost once."""
        mute = number in self.muted
        self.muted.discard(number or 0)
        return mute

    def due(self, now: float, received: int) -> Fault | None:
        """The next one that is due by clock (s) or bytes received."""
        if self._by_time and self._by_time[-1][0] <= now:
            return self._by_time.pop()[1]
        if self._by_bytes and self._by_bytes[-1][0] <= received:
            return self._by_bytes.pop()[1]
        return None


def apply_fault(board: Controller, fault: Fault) -> bool:
    """Let a fault happen; True when the board forgets what it was doing."""
    now, seconds = board.machine.now, fault.seconds or 0.0
    match fault.fault:
        case "reset":
            board.reset()
        case "kill":
            board.firmware.fail_heat(HeatFault.RUNAWAY)
        case "unplug":
            board.unplugged, board.back_after_s = True, fault.back_after_s
        case "runaway":
            board.machine.heat.hotend.lose_power(now)
        case "drop_ok":
            board.plan.muted.add(fault.line or 0)
        case "noise":
            board.bad_line.burst(fault.rate or 0.0, fault.length_bytes or 0)
        case "delay":
            board.bad_line.hold(seconds)
        case "stall":
            board.pace.stall(now, seconds)
        case "endstop_stuck":
            board.machine.stuck["xyz".index(fault.axis or "x")] = fault.stuck or "open"
    return fault.fault in ("reset", "kill")
