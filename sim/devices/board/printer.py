"""Base class of simulated printers: bytes in, bytes out, in virtual time, no I/O.

Modelled of any board, whatever its firmware:

- the serial line: bytes take their time at the baud rate, both ways; a receive ring that overruns;
  a command queue from which ``ok`` comes when a command is done (a move is done when it is in the
  planner); line assembly with comments and overlong lines;
- planner, stepper and their times (`sim.gcode.motion.planner`), step counters, G92 as a shift of
the
  workspace; heaters with thermal mass; settings that are stored;
- faults that it is told to have (`sim.devices.faults`), and a bad cable
  (`sim.devices.faults`) for whoever owns the port.

What a firmware does with that is its family's (`sim.devices.board.firmware`,
`sim/devices/families/`).

Not modelled: SD card, display, probe, a mesh (levelling knows a slope), endstops that are hit
(G28 is a straight run to the low end, and a switch fails only as a fault says), a head's own
temperature where there are several, sensors' noise, heaters' control loop, bytes that the line
invents, the stutter of an overloaded processor, motors that lose steps. The software endstops
count only on axes that were homed: a machine that wasn't homed runs wherever it is told, and the
host must keep it inside.

Time. The clock advances only by the printer's own waits: bytes on the wire, the processor's time
for a command, a full planner, M400, G4, a wait for heat. So a slow host can't starve the
simulated planner: between two lines no more time passes than they take on the wire. Where the
passing of time is itself what is looked at, `SimulatedPrinter.advance` lets it pass.

Line numbers. A block's ``line`` in the executed motion is the job's command where the printer was
given the file to compare with (`job`; with the host's journal, of the job as it has grown by
inserts), -1 for what a host puts in. Without it, it is the line's N
word minus one (a job's first line is N1), in which a host's own lines count, and -1 for a line
without a number.
"""

from __future__ import annotations

import math

from firmware_profiles import Printer
from sim.devices.board.controller import Controller
from sim.devices.board.main_loop import MainLoop
from sim.devices.faults import Fault
from sim.gcode.motion.executed import ExecutedMotion
from sim.gcode.motion.hardware import Board


class SimulatedPrinter(Controller):
    """A board and the loop that brings it on; a family's class adds `make_firmware`, no more.

    Parameters and attributes are those of `sim.devices.board.controller.Controller`.
    """

    def __init__(
        self,
        printer: Printer,
        start_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
        board: Board = Board(),  # noqa: B008
        faults: tuple[Fault, ...] = (),
    ) -> None:
        super().__init__(printer, start_mm, board, faults)
        self._loop = MainLoop(self)

    @property
    def now(self) -> float:
        """The printer's clock, s."""
        return self.machine.now

    @property
    def wakes_s(self) -> float:
        """When it next has something to say or do without the host, s, after `run_to`."""
        return max(self._loop.wakes_s, self.now)

    @property
    def dead(self) -> bool:
        """Whether the firmware is killed: silent until a reset."""
        return self.machine.dead

    @property
    def idle(self) -> bool:
        """Whether every line is answered and every motor stands."""
        return not self._loop.pending and self.machine.motion.blocks == 0

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

        The firmware may take lines at once that need no main loop; this is the call for speed.
        """
        rest = self.firmware.take_at_once(data, self._loop.next_alarm_s)
        if rest:
            self.receive(rest)
            self.settle()
        return self.take_output()

    def settle(self) -> None:
        """Work until nothing is left to do without the host; motors may still run."""
        self._loop.run(math.inf)

    def advance(self, seconds: float) -> None:
        """Let time pass."""
        self.run_to(self.machine.now + seconds)

    def run_to(self, time: float) -> None:
        """Work until the printer's clock shows ``time``, s."""
        self._loop.run(time)
        self.machine.now = max(self.machine.now, time)
        self.machine.roll()

    def finish(self) -> None:
        """Let all accepted moves end, as a printer does whose host has gone."""
        self.settle()
        motion = self.machine.motion
        while motion.blocks:
            self.run_to(max(self.machine.now, motion.next_event()))

    def executed(self) -> ExecutedMotion:
        """What really moved so far."""
        return self.machine.executed()
