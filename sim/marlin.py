"""A simulated printer with Marlin 2.1 firmware: bytes in, bytes out, in virtual time, no I/O.

Modelled, after the transcripts recorded from a real Marlin (`tests/sim/data/marlin`):

- the serial line: bytes take their time at the baud rate, both ways; a receive ring of 128 bytes
  that overruns; a command queue of 4 from which ``ok`` comes when a command is done (a move is
  done when it is in the planner); line assembly with comments and overlong lines;
- line numbers and checksums: errors, ``Resend`` with its trailing ``ok`` and the flush in
  mid-line, repeated lines dropped without an answer;
- planner, stepper and their times (`sim.planner`), step counters, G92 as a shift of the
  workspace;
- busy messages, reports of temperature and position, dwells, waits for heat and for the user,
  heaters with thermal mass, cold extrusion, M85, M112, M410, M108 with and without emergency
  parser, ADVANCED_OK, kill (silence until a reset) and reset.

Not modelled: SD card, display, probe and levelling, endstops that are hit (G28 is a straight run
to the low end), several extruders, sensors' noise, heaters' control loop, EEPROM (settings last
until a reset), bits that flip on the line, the stutter of an overloaded processor. As in the real
firmware the software endstops count only on axes that were homed: a machine that wasn't homed
runs wherever it is told, and the host must keep it inside.

Time. The clock advances only by the printer's own waits: bytes on the wire, the processor's time
for a command, a full planner, M400, G4, a wait for heat. So a slow host can't starve the
simulated planner: between two lines no more time passes than they take on the wire. Where the
passing of time is itself what is looked at, `MarlinPrinter.advance` lets it pass.

Line numbers. A block's ``line`` in the executed motion is its N word minus one (a job's first
line is N1), -1 for a line without a number.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import numpy as np

from firmware_profiles import Printer
from sim.executed import ExecutedMotion
from sim.gcode import Command, command_of, split_line
from sim.gcode_modal import BAD, arc_points, interpret, speed
from sim.gcode_words import WORDS
from sim.marlin_board import Board, Fault, FaultKind
from sim.marlin_codes import is_known
from sim.marlin_commands import HANDLERS, Steps, planned_position, quickstop
from sim.marlin_fast import NOT_TAKEN, take_numbered_move
from sim.marlin_lines import LineReader, Refused
from sim.marlin_machine import Machine, Place, Task, Wait
from sim.marlin_texts import BANNER
from sim.marlin_wire import Wire

_OK: Final = b"ok\n"
_LONGEST_EXTRUSION_MM: Final = 200.0


class MarlinPrinter:
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
        What goes wrong, and at which line number.

    Attributes
    ----------
    machine : Machine
        Clock, motors, heaters.
    unplugged : bool
        Set by a fault; whoever owns the port closes it.
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
        self.wire = Wire(printer.baud, printer.receive_buffer_bytes, printer.emergency_parser)
        self.machine = Machine(printer, start_mm, board, self.wire.byte_s)
        self.lines = LineReader(printer.max_line_bytes)
        self.words = np.zeros(1, WORDS)
        self.unplugged = False
        self.synced = 0
        self._faults: dict[int, FaultKind] = {fault.line: fault.kind for fault in faults}
        self._mute: set[int] = set()
        self._queue: deque[bytes] = deque()
        self._tasks: list[tuple[Task, Wait]] = []
        self._command = b""
        self._answered = False
        self._busy_at = math.inf
        self._sensor_fault_at = math.inf
        self._hush = False

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
        if not self.machine.dead:
            self.machine.finish()

    def executed(self) -> ExecutedMotion:
        """What really moved so far."""
        return self.machine.executed()

    def reset(self) -> None:
        """Reset line or power button: everything is forgotten, motors stop, the banner comes."""
        self.machine.stop()
        self._forget()
        self.lines.clear()
        self.machine.power_up()
        for line in BANNER:
            self.machine.say(line)

    def kill(self, reason: str) -> None:
        """Stop everything and fall silent."""
        self.machine.stop()
        self.machine.heaters_off()
        self.machine.say(f"echo:{reason}")
        self.machine.say("Error:Printer halted. kill() called!")
        self.machine.say("//action:poweroff")
        self._forget()
        self.machine.dead = True

    # -- what commands need

    def say_ok(self, rest: str = "") -> None:
        """Answer the present command; no other ok will follow."""
        self._answered = True
        if self._hush:
            self._hush = False
        else:
            self.machine.say("ok" + rest)

    def request_resend(self) -> None:
        """Ask for the line after the last good one; what is in the ring is thrown away."""
        self.wire.flush()
        self.machine.say(f"Resend: {self.lines.last_number + 1}")
        self.machine.say("ok")

    def sensor_fails_at(self, time: float) -> None:
        """A heater was switched on whose thermistor reads nonsense."""
        self._sensor_fault_at = min(self._sensor_fault_at, time)

    # -- the short road

    def _take_plain_moves(self, data: bytes) -> bytes:
        """Take the plain moves at the front of ``data``; returns what is left."""
        wire, machine = self.wire, self.machine
        if machine.dead or self._tasks or self._queue or len(data) > wire.capacity:
            return data
        if not wire.quiet or not self.lines.empty:
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
        if expected in self._faults or arrived < machine.closed_until:
            return False
        board = machine.board
        taken = take_numbered_move(
            data,
            expected,
            machine.printer.max_line_bytes - 1,
            machine.too_cold,
            machine.modal,
            self.words,
            machine.planner,
            machine.ring,
            machine.log,
            arrived,
            min(self._alarm(), arrived + (machine.reports.keepalive_s or math.inf)),
            board.command_s,
            board.step_s,
        )
        if taken == NOT_TAKEN:
            return False
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

    # -- the general road

    def _pending(self) -> bool:
        return bool(self._tasks or self._queue or not self.wire.quiet)

    def _run(self, until: float) -> None:
        """Work in the order of time until ``until``, or until only the host can go on."""
        machine = self.machine
        while machine.now <= until:
            self.wire.deliver(machine.now)
            if machine.dead:
                self.wire.flush()
                self._queue.clear()
            elif self._step():
                continue
            at = self.wire.next_arrival()
            if machine.dead:
                soon = math.inf if at is None else at
            elif math.isinf(until) and not self._pending():
                return
            else:
                soon = min(self._alarm(), math.inf if at is None else at, self._task_at())
            if math.isinf(soon) or soon > until:
                return
            if math.isinf(until) and at is None and self._waits_for_host():
                return
            machine.now = max(machine.now, soon)

    def _waits_for_host(self) -> bool:
        """Whether the present wait ends by no clock, or nothing at all is being done."""
        return not self._tasks or math.isinf(self._task_at())

    def _task_at(self) -> float:
        return self._tasks[-1][1].at(self.machine) if self._tasks else math.inf

    def _alarm(self) -> float:
        """When the main loop next has something to say or do of its own, s."""
        machine = self.machine
        reports = machine.reports
        soon = min(reports.temperature_at, reports.position_at, self._sensor_fault_at)
        if self._tasks:
            soon = min(soon, self._busy_at)
        if machine.idle_limit_s > 0:
            soon = min(soon, self._idle_deadline())
        return soon

    def _idle_deadline(self) -> float:
        machine = self.machine
        if machine.blocks:
            return max(machine.next_motion(), machine.now) + machine.idle_limit_s
        return max(machine.idle_since, float(machine.planner["run_end"][0])) + machine.idle_limit_s

    def _step(self) -> bool:
        """Do one thing that is due now; False when nothing is."""
        machine = self.machine
        machine.roll()
        if self.wire.urgent:
            self._urgent(self.wire.urgent.pop(0))
            return True
        if machine.now >= self._alarm():
            self._sound_alarms()
            return True
        if self._tasks:
            task, wait = self._tasks[-1]
            if wait.done(machine):
                self._resume(task)
                return True
        elif self._queue:
            self._start(self._queue[0])
            return True
        return self._read_line()

    def _read_line(self) -> bool:
        """Move one line from the ring to the queue, or refuse it."""
        if len(self._queue) >= self.machine.printer.command_queue:
            return False
        line = self.lines.next_line(self.wire.ring)
        if line is None:
            return False
        before = self.lines.last_number
        accepted = self.lines.accept(line)
        if isinstance(accepted, Refused):
            text = accepted.reason.decode()
            self.machine.say(f"Error:{text}, Last Line: {self.lines.last_number}")
            self.request_resend()
        elif accepted is not None:
            number = self.lines.last_number
            if number != before and number in self._faults and self._fails(number):
                return True
            self._queue.append(accepted)
            self._act_early(accepted)
        return True

    def _fails(self, number: int) -> bool:
        """Let the fault of a line happen; True when the line is lost with it."""
        fault = self._faults.pop(number)
        if fault == "reset":
            self.reset()
        elif fault == "kill":
            self.machine.say("Error:Thermal Runaway, system stopped! Heater_ID: E0")
            self.kill("THERMAL RUNAWAY")
        elif fault == "unplug":
            self.unplugged = True
        else:
            self._mute.add(number)
        return fault in ("reset", "kill")

    def _act_early(self, line: bytes) -> None:
        """Without emergency parser: M112, M410 and M108 act when they enter the queue."""
        if self.machine.printer.emergency_parser:
            return
        name = line[:4]
        if name in (b"M112", b"M410", b"M108"):
            self._urgent(name[1:])

    def _urgent(self, code: bytes) -> None:
        if code == b"112":
            self.kill("M112 Shutdown")
        elif code == b"108":
            self.machine.waits_for_user = False
            self.machine.waits_for_heat = False
        else:
            self._begin(quickstop(self))

    def _sound_alarms(self) -> None:
        machine = self.machine
        reports = machine.reports
        now = machine.now
        if now >= self._sensor_fault_at:
            machine.say("Error:MINTEMP triggered, system stopped! Heater_ID: E0")
            self.kill("Err: MINTEMP")
            return
        if self._tasks and now >= self._busy_at:
            machine.say(f"echo:busy: {self._tasks[-1][1].busy}")
            self._busy_at = now + reports.keepalive_s
        if now >= reports.temperature_at:
            machine.say(machine.temperatures())
            reports.temperature_at += reports.temperature_s
        if now >= reports.position_at:
            machine.say(planned_position(self))
            reports.position_at += reports.position_s
        if machine.idle_limit_s > 0 and now >= self._idle_deadline():
            machine.say(
                "Error:!! KILL caused by too much inactive time - current command: "
                + self._command.decode("latin-1")
            )
            self.kill("KILLED.")

    def _start(self, line: bytes) -> None:
        """Take the oldest command of the queue in hand."""
        machine = self.machine
        machine.now += self._command_time()
        machine.roll()
        self._command = line
        self._answered = False
        split_line(line, self.words)
        command = command_of(line, self.words)
        if command.line_number in self._mute:
            self._mute.discard(command.line_number)
            self._hush = True
        keepalive = machine.reports.keepalive_s
        self._busy_at = machine.now + keepalive if keepalive > 0 else math.inf
        if machine.debug & 1:
            machine.say("echo:" + line.decode("latin-1"))
        self._begin(self._work(command))

    def _command_time(self) -> float:
        """Processor's time for a command beside the stepper's interrupt."""
        machine = self.machine
        board = machine.board
        load = 0.0
        if machine.state["running"]:
            rate = int(machine.ring["nominal_rate"][int(machine.state["tail"])])
            load = min(rate * board.step_s, board.most_load)
        return board.command_s / (1.0 - load)

    def _work(self, command: Command) -> Steps:
        if command.letter == "G" and command.number <= 3:
            return self._move(command)
        if command.letter == "T":
            return None
        name = f"{command.letter}{command.number}"
        if not is_known(command.letter, command.number):
            shown = b'echo:Unknown command: "' + command.text + b'"'
            self.machine.say(shown)
            return None
        return HANDLERS[name](self, command)

    def _move(self, command: Command) -> Task:
        machine = self.machine
        begin = machine.modal["position"][0].copy()
        kind = interpret(machine.modal[0], self.words[0])
        if kind == BAD:
            machine.say("Error:G2/G3 bad parameters")
            return
        line = (command.line_number or 0) - 1
        target = machine.modal["position"][0].copy()
        if target[3] != begin[3] and self._no_extrusion(abs(target[3] - begin[3])):
            machine.set_plunger(float(target[3]))
        points = target[None]
        if command.number >= 2:
            points = _arc(begin, target, self.words, float(machine.modal["unit"][0]))
        feed = float(speed(machine.modal[0]))
        for point in points:
            yield Place()
            machine.move_to(point, feed, line)
        machine.idle_since = machine.now

    def _no_extrusion(self, travel_mm: float) -> bool:
        """Whether the firmware drops the plunger's part of a move; it says why."""
        if self.machine.too_cold:
            self.machine.say("echo: cold extrusion prevented")
            return True
        if travel_mm > _LONGEST_EXTRUSION_MM:
            self.machine.say("echo: too long extrusion prevented")
            return True
        return False

    def _begin(self, steps: Steps) -> None:
        """Run a task up to its first wait that isn't over."""
        if steps is None:
            self._end_command()
        else:
            self._resume(steps, fresh=True)

    def _resume(self, task: Task, fresh: bool = False) -> None:
        if not fresh:
            self._tasks.pop()
        wait = next(task, None)
        if self.machine.dead:
            return
        if wait is not None:
            self._tasks.append((task, wait))
        elif not self._tasks:
            self._end_command()

    def _end_command(self) -> None:
        """Answer the command in hand and take it off the queue."""
        if self.machine.dead or not self._queue:
            return
        if not self._answered:
            self._say_advanced_ok() if self.machine.printer.advanced_ok else self.say_ok()
        self._queue.popleft()
        if self._command.lstrip(b"N0123456789- ").startswith(b"M400"):
            self.synced += 1

    def _say_advanced_ok(self) -> None:
        """The answer with line number, free planner blocks and free places in the queue."""
        machine = self.machine
        word = b""
        if self._command.startswith(b"N"):
            word = b" " + self._command.split(b" ")[0]
        blocks = len(machine.ring) - 1 - machine.blocks
        queue = machine.printer.command_queue - max(len(self._queue), 1)
        self.say_ok(f"{word.decode('latin-1')} P{blocks} B{queue}")

    def _forget(self) -> None:
        self._queue.clear()
        self._tasks.clear()
        self.wire.clear()
        self._mute.clear()
        self._hush = False
        self._busy_at = math.inf
        self._sensor_fault_at = math.inf


def _arc(
    begin: np.ndarray,
    target: np.ndarray,
    words: np.ndarray,
    unit: float,  # type: ignore[type-arg]
) -> np.ndarray:  # type: ignore[type-arg]
    points = np.empty((256, 4))
    count = arc_points(begin, target, words[0], unit, points)
    if count > len(points):
        points = np.empty((count, 4))
        arc_points(begin, target, words[0], unit, points)
    return points[:count]
