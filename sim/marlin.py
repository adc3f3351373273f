"""A simulated printer with Marlin 2.1 firmware: bytes in, bytes out, in virtual time, no I/O.

Modelled, after the transcripts recorded from a real Marlin (`tests/sim/data/marlin`):

- the serial line: bytes take their time at the baud rate, both ways; a receive ring of 128 bytes
  that overruns; a command queue of 4 from which ``ok`` comes when a command is done (a move is
  done when it is in the planner); line assembly with comments and overlong lines;
- line numbers and checksums: errors, ``Resend`` with its trailing ``ok`` and the flush in
  mid-line, repeated lines dropped without an answer;
- planner, stepper and their times (`sim.planner`), step counters, G92 as a shift of the
  workspace;
- faults that it is told to have (`sim.faults`), and a bad cable (`sim.bad_line`) for whoever
  owns the port;
- busy messages, reports of temperature and position, dwells, waits for heat and for the user,
  heaters with thermal mass, cold extrusion, M85, M112, M410, M108 with and without emergency
  parser, ADVANCED_OK, reset, and kill: silence until a reset, and motors that run on for a while
  (`sim.marlin_halt`).

Not modelled: SD card, display, probe and levelling, endstops that are hit (G28 is a straight run
to the low end, and a switch fails only as a fault says), a head's own temperature where there are
several, sensors' noise, heaters' control loop and its tuning (M303), the EEPROM's image (stored
settings outlast a reset, their CRC is always the same), bytes that the line invents, the stutter
of an overloaded processor, motors that lose steps. As in the real firmware the software endstops
count only on axes that were homed: a machine that wasn't homed runs wherever it is told, and the
host must keep it inside.

Time. The clock advances only by the printer's own waits: bytes on the wire, the processor's time
for a command, a full planner, M400, G4, a wait for heat. So a slow host can't starve the
simulated planner: between two lines no more time passes than they take on the wire. Where the
passing of time is itself what is looked at, `MarlinPrinter.advance` lets it pass.

Line numbers. A block's ``line`` in the executed motion is the file's command where the printer was
given the file to compare with (`job`), -1 for what a host puts in. Without it, it is the line's N
word minus one (a job's first line is N1), in which a host's own lines count, and -1 for a line
without a number.
"""

from __future__ import annotations

import math
from typing import Final

from firmware_profiles import Printer
from sim.executed import ExecutedMotion
from sim.faults import Fault
from sim.gauges import Gauge
from sim.gcode import Command
from sim.marlin_board import Board
from sim.marlin_fast import NOT_TAKEN, take_numbered_move
from sim.marlin_loop import MainLoop
from sim.marlin_waits import Steps

_OK: Final = b"ok\n"


class MarlinPrinter(MainLoop):
    """The firmware's state machine.

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
    gauges : dict of str to Gauge
        Sensors that it tells of, by the command that asks; what no real Marlin of ours has.
    """

    def __init__(
        self,
        printer: Printer,
        start_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
        board: Board = Board(),  # noqa: B008
        faults: tuple[Fault, ...] = (),
    ) -> None:
        super().__init__(printer, start_mm, board, faults)
        self.gauges: dict[str, Gauge] = {}

    # -- the outside

    @property
    def now(self) -> float:
        """The printer's clock, s."""
        return self.machine.now

    @property
    def dead(self) -> bool:
        """Whether the firmware is killed: silent until a reset."""
        return self.machine.dead

    @property
    def idle(self) -> bool:
        """Whether every line is answered and every motor stands."""
        return not self._pending() and self.machine.blocks == 0

    def receive(self, data: bytes) -> None:
        """Put bytes on the wire; they arrive one after the other from now on."""
        self.wire.send(self.machine.now, data)

    def take_output(self) -> bytes:
        """What the printer has said since the last call."""
        data = bytes(self.machine.output)
        self.machine.output.clear()
        return data

    def exchange(self, data: bytes) -> bytes:
        """Receive, work until only the host can bring things on, and answer.

        The plain next line of a print takes a short road; this is the call for speed.
        """
        rest = self._take_plain_moves(data)
        if rest:
            self.receive(rest)
            self.settle()
        return self.take_output()

    def settle(self) -> None:
        """Work until nothing is left to do without the host; motors may still run."""
        self._run(math.inf)

    def advance(self, seconds: float) -> None:
        """Let time pass."""
        self.run_to(self.machine.now + seconds)

    def run_to(self, time: float) -> None:
        """Work until the printer's clock shows ``time``, s."""
        self._run(time)
        self.machine.now = max(self.machine.now, time)
        self.machine.roll()

    def finish(self) -> None:
        """Let all accepted moves end, as a printer does whose host has gone."""
        self.settle()
        while self.machine.blocks:
            self.run_to(max(self.machine.now, self.machine.next_motion()))

    def executed(self) -> ExecutedMotion:
        """What really moved so far."""
        return self.machine.executed()

    def _work(self, command: Command) -> Steps:
        gauge = self.gauges.get(f"{command.letter}{command.number}")
        if gauge is None:
            return super()._work(command)
        self.machine.say(gauge.at(self.machine.now))
        return None

    # -- the short road

    def _take_plain_moves(self, data: bytes) -> bytes:
        """Take the plain moves at the front of ``data``; returns what is left."""
        wire, machine = self.wire, self.machine
        if machine.dead or machine.has_least_feeds:
            return data
        if self._tasks or self._queue or len(data) > wire.capacity:
            return data
        if not wire.quiet or not self.lines.empty or self.plan.counts_bytes:
            return data
        arrived = wire.occupied_until(machine.now)
        while data:
            end = data.find(b"\n") + 1
            line = data if end == len(data) else data[:end]
            arrived += end * wire.byte_s
            if end == 0 or not self._take_plain_move(line, max(arrived, machine.now)):
                return data
            data = data[end:]
        return data

    def _take_plain_move(self, data: bytes, arrived: float) -> bool:
        wire, machine = self.wire, self.machine
        expected = self.lines.last_number + 1
        if self.plan.has_line(expected) or arrived < machine.closed_until:
            return False
        taken = take_numbered_move(
            data,
            expected,
            machine.printer.max_line_bytes - 1,
            machine.too_cold or machine.dry,
            machine.modal,
            self.words,
            machine.planner,
            machine.ring,
            machine.log,
            arrived,
            min(self._alarm(), arrived + (machine.reports.keepalive_s or math.inf)),
            expected - 1 if self.job is None else self.job.find(data),
            machine.costs,
        )
        if taken == NOT_TAKEN:
            return False
        if self.job is not None:
            self.job.take(data)
        machine.now = taken
        machine.idle_since = taken
        self.lines.last_number = expected
        if machine.printer.advanced_ok:
            self._command = data
            self._say_advanced_ok()
        else:
            machine.output += _OK
            machine.now += 3 * wire.byte_s
        return True
