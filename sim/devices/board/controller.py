"""Controller board of a simulated printer: assembles its parts; reset and emergency stop."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np

from firmware_profiles import Printer
from sim.devices.board.fault_plan import FaultPlan
from sim.devices.board.firmware import Firmware
from sim.devices.board.lines import LineReader, Numbering
from sim.devices.board.machine import Machine
from sim.devices.board.waits import Steps
from sim.devices.board.wire import BITS_PER_BYTE, Wire
from sim.devices.board.work import BoardWork
from sim.devices.faults.cable import FaultyCable
from sim.devices.faults.clock_pace import Pace
from sim.devices.faults.fault_file import Fault
from sim.devices.faults.gauge import Gauge
from sim.gcode.motion.hardware import Board
from sim.gcode.program.gcode import Command
from sim.gcode.program.words import WORDS


class Job(Protocol):
    """A file that is printed (`sim.devices.serving.job_lines.JobLines`)."""

    def find(self, line: bytes) -> int:
        """Place in the file of a line; -1 for a host's own."""

    def take(self, line: bytes) -> int:
        """The same, of a line that is done now."""


class Controller(ABC):
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
        The family's own part, made by `make_firmware`.
    machine : Machine
        Clock, motors, heaters.
    wire : Wire
        Bytes in flight and the receive ring.
    reader, lines : LineReader, Numbering
        What cuts lines, and what decides about their numbers.
    words : (1,) of `sim.gcode.program.words.WORDS`
        Of the command in hand.
    work : BoardWork
        Commands in line and in hand.
    plan : FaultPlan
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

    def __init__(
        self,
        printer: Printer,
        start_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
        board: Board = Board(),  # noqa: B008
        faults: tuple[Fault, ...] = (),
    ) -> None:
        self.machine = Machine(printer, start_mm, board, BITS_PER_BYTE / printer.baud)
        self.firmware = self.make_firmware()
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

    @abstractmethod
    def make_firmware(self) -> Firmware:
        """Return the family's own part, made for this board."""

    def reset(self) -> None:
        """Reset line or power button: everything is forgotten, motors stop, the banner comes."""
        self.machine.stop()
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
        run_on = self.firmware.run_on()
        if run_on is None:
            self.machine.stop()
        self.machine.heaters_off()
        self.firmware.say_halted(reason)
        self._forget()
        self.machine.dead = True
        self.machine.run_on = None if run_on is None else run_on(self.machine)
        self.firmware.answer_unserved(waiting)

    def _forget(self) -> None:
        self.work.forget()
        self.wire.clear()
        self.plan.muted.clear()

    @property
    def halted(self) -> bool:
        """Whether the firmware is killed and the motors stand."""
        return self.machine.dead and self.machine.run_on is None

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
