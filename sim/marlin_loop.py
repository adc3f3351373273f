"""The simulated firmware's main loop: read lines, run commands, wait, report; in virtual time.

One loop as the firmware has it: look into the receive ring, queue lines, say what is due, take
the oldest command in hand, wait for what it waits for. The clock jumps from one event to the
next. `sim.marlin` puts the outside around it and says what is modelled.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np

from firmware_profiles import Printer
from sim.bad_line import BadLine
from sim.fault_plan import FaultPlan, happen
from sim.faults import Fault
from sim.gcode import Command, command_of, split_line
from sim.gcode_modal import ARC, BAD, interpret, speed
from sim.gcode_words import WORDS
from sim.job_lines import JobLines
from sim.line_times import BLOCK_S, CORNER_S, TRAPEZOID_S
from sim.marlin_arc import arc_of
from sim.marlin_board import Board
from sim.marlin_commands import HANDLERS, Handler
from sim.marlin_halt import RunOn
from sim.marlin_lines import LineReader, Refused
from sim.marlin_machine import Machine, Place, Task, Until, Wait
from sim.marlin_tells import advanced_ok, planned_position
from sim.marlin_texts import BANNER
from sim.marlin_tools import m218, take_tool
from sim.marlin_waits import Steps, quickstop
from sim.marlin_wire import Wire
from sim.pace import Pace

_LONGEST_EXTRUSION_MM: Final = 200.0
_ARC_PIECE_S: Final = BLOCK_S + CORNER_S + 2 * TRAPEZOID_S
"""Between two pieces of an arc: the planner's time for each."""
_SYNC: Final = re.compile(rb"(?:N[-0-9]*)? *M0*400(?!\d)")


class MainLoop:
    """Reads, runs, waits and answers.

    Attributes
    ----------
    machine : Machine
        Clock, motors, heaters.
    wire : Wire
        Bytes in flight and the receive ring.
    lines : LineReader
        Line numbers and checksums.
    words : (1,) of `sim.gcode_words.WORDS`
        Of the command in hand.
    unplugged : bool
        Set by a fault; whoever owns the port closes it.
    back_after_s : float or None
        After how long it is plugged in again; None for never.
    bad_line : BadLine
        The cable, for whoever owns the port.
    pace : Pace
        The board's clock against the host's, for whoever owns the port.
    job : JobLines or None
        The file that is printed, if it is known: it tells its commands from a host's own lines.
    synced : int
        How often the host has had the motors waited for (M400); a good moment to keep a record.
    """

    def __init__(
        self,
        printer: Printer,
        start_mm: tuple[float, float, float],
        board: Board,
        faults: tuple[Fault, ...],
    ) -> None:
        self.wire = Wire(printer.baud, printer.receive_buffer_bytes, printer.emergency_parser)
        self.machine = Machine(printer, start_mm, board, self.wire.byte_s)
        self.lines = LineReader(printer.max_line_bytes)
        self.words = np.zeros(1, WORDS)
        self.unplugged = False
        self.back_after_s: float | None = None
        self.bad_line = BadLine()
        self.pace = Pace()
        self.synced = 0
        self.plan = FaultPlan(faults)
        self.job: JobLines | None = None
        self._job_line = -1
        self._queue: deque[bytes] = deque()
        self._tasks: list[tuple[Task, Wait, bool]] = []
        self._command, self._answered = b"", False
        self._busy_at = math.inf
        self._hush = False

    # -- reset and kill

    def reset(self) -> None:
        """Reset line or power button: everything is forgotten, motors stop, the banner comes."""
        self.machine.stop()
        self._forget()
        self.lines.clear()
        self.machine.power_up()
        for line in self.banner:
            self.machine.say(line)

    def kill(self, reason: str) -> None:
        """Heaters off, fall silent, and halt: the motors at once, or after the firmware's wait."""
        if not self.motors_run_on:
            self.machine.stop()
        self.machine.heaters_off()
        self.say_halted(reason)
        self._forget()
        self.machine.dead = True
        if self.motors_run_on:
            self.machine.run_on = RunOn(self.machine)

    @property
    def halted(self) -> bool:
        """Whether the firmware is killed and the motors stand."""
        return self.machine.dead and self.machine.run_on is None

    def _halt_when_due(self) -> float:
        """Stop the motors of a killed board if it is time; else when to look again, s."""
        machine = self.machine
        if machine.run_on is None:
            return math.inf
        due = machine.run_on.ends_s(machine)
        if machine.now < due:
            return due
        machine.stop()
        machine.run_on = None
        return math.inf

    # -- what dialects say otherwise

    handlers: ClassVar[Mapping[str, Handler]] = HANDLERS
    too_cold_words: ClassVar[str] = "echo: cold extrusion prevented"
    banner: ClassVar[tuple[str, ...]] = BANNER
    offsets_by: ClassVar[str] = "M218"
    motors_run_on: ClassVar[bool] = True  # after a kill, for `sim.marlin_halt`'s time
    whole_percents: ClassVar[bool] = True

    def say_unknown(self, command: Command) -> None:
        """There is no such command."""
        self.machine.say(b'echo:Unknown command: "' + command.text + b'"')

    def say_halted(self, reason: str) -> None:
        """It stops for good."""
        self.machine.say(f"echo:{reason}")
        self.machine.say("Error:Printer halted. kill() called!")
        self.machine.say("//action:poweroff")

    def hear_dead(self) -> None:
        """Take what comes after a halt: nothing is heard."""
        self.wire.flush()

    def idle_is_over(self) -> None:
        """Nothing has moved for longer than the firmware was told to bear."""
        self.machine.say(
            "Error:!! KILL caused by too much inactive time - current command: "
            + self._command.decode("latin-1")
        )
        self.kill("KILLED.")

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
        self.wire.deliver(self.machine.now)
        self.wire.flush()
        self.machine.say(f"Resend: {self.lines.last_number + 1}")
        self.machine.say("ok")

    def hold_busy(self) -> None:
        """Say nothing of being busy until the present command is done."""
        self._busy_at = math.inf

    # -- the general road

    def _pending(self) -> bool:
        return bool(self._tasks or self._queue or not self.wire.quiet)

    def _run(self, until: float) -> None:
        """Work in the order of time until ``until``, or until only the host can go on."""
        machine, settles = self.machine, math.isinf(until)
        while machine.now <= until:
            self.wire.deliver(machine.now)
            stalled = machine.now < machine.stalled_until
            halts_at = self._halt_when_due()
            if machine.dead:
                self.hear_dead()
            elif not stalled and self._step():
                continue
            at = self.wire.next_arrival()
            if stalled:
                soon = machine.stalled_until
            elif machine.dead:
                soon = min(math.inf if at is None else at, math.inf if settles else halts_at)
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
        soon = min(reports.temperature_at, reports.position_at, machine.heat_alarm().at)
        soon = min(soon, self.plan.next_s)
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
            self._read_line()  # it is looked at before the flag that the interrupt has set
            if self.wire.urgent:
                self._urgent(self.wire.urgent.pop(0))
            return True
        if (fault := self.plan.due(machine.now, self.wire.received)) is not None:
            happen(self, fault)
            return True
        if machine.now >= self._alarm():
            self._sound_alarms()
            return True
        if self._read_line():
            return True
        if self._tasks:
            task, wait, answers = self._tasks[-1]
            if wait.done(machine):
                self._tasks.pop()
                self._resume(task, answers)
                return True
        elif self._queue:
            self._start(self._queue[0])
            return True
        return False

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
            fault = self.plan.at_line(number) if number != before else None
            if fault is not None and happen(self, fault):
                return True
            self._queue.append(accepted)
            self._act_early(accepted)
        return True

    def _act_early(self, line: bytes) -> None:
        """Without emergency parser: M112, M410 and M108 act when they enter the queue."""
        if self.machine.printer.emergency_parser:
            return
        if (name := line[:4]) in (b"M112", b"M410", b"M108"):
            self._urgent(name[1:])

    def _urgent(self, code: bytes) -> None:
        if code == b"112":
            self.kill("M112 Shutdown")
        elif code == b"108":
            self.machine.waits_for_user = False
            self.machine.waits_for_heat = False
        else:
            self._begin(quickstop(self), False)

    def _sound_alarms(self) -> None:
        machine = self.machine
        reports = machine.reports
        now = machine.now
        heat = machine.heat_alarm()
        if now >= heat.at:
            machine.say(f"Error:{heat.error}, system stopped! Heater_ID: E0")
            self.kill(heat.reason)
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
            self.idle_is_over()

    def _start(self, line: bytes) -> None:
        """Take the oldest command of the queue in hand."""
        machine = self.machine
        machine.now += machine.command_s()
        machine.roll()
        self._command = line
        self._answered = False
        split_line(line, self.words)
        command = command_of(line, self.words)
        self._hush |= self.plan.is_mute(command.line_number)
        self._job_line = self.job.take(line) if self.job else (command.line_number or 0) - 1
        keepalive = machine.reports.keepalive_s
        self._busy_at = machine.now + keepalive if keepalive > 0 else math.inf
        if machine.debug & 1:
            machine.say("echo:" + line.decode("latin-1"), b"\r\n")
        self._begin(self._work(command))

    def _work(self, command: Command) -> Steps:
        if command.letter == "G" and command.number <= 3:
            return self._move(command)
        if command.letter == "T":
            return self.take_tool(command)
        name = f"{command.letter}{command.number}"
        if name in self.handlers:
            return self.handlers[name](self, command)
        if name == self.offsets_by and self.machine.printer.head_count > 1:
            m218(self, command)
        elif name not in self.machine.printer.extra_commands:
            self.say_unknown(command)
        return None

    take_tool = take_tool

    def _move(self, command: Command) -> Task:
        machine = self.machine
        begin = machine.modal["position"][0].copy()
        kind = interpret(machine.modal[0], self.words[0])
        target = machine.modal["position"][0].copy()
        points = target[None]
        if kind == ARC:
            points = arc_of(begin, target, self.words, float(machine.modal["unit"][0]))
        if kind == BAD or not len(points):
            machine.modal["position"][0] = begin
            machine.say("Error:G2/G3 bad parameters")
            return
        if target[3] != begin[3] and self._no_extrusion(abs(target[3] - begin[3])):
            machine.set_plunger(float(target[3]))
        machine.modal["position"][0] = points[-1]
        feed = float(speed(machine.modal[0]))
        for point in points:
            yield Place()
            machine.move_to(point, feed, self._job_line)
            if len(points) > 1:
                yield Until(machine.now + _ARC_PIECE_S)
        machine.idle_since = machine.now

    def _no_extrusion(self, travel_mm: float) -> bool:
        """Whether the firmware drops the plunger's part of a move; it says why, but for M111 S8."""
        if self.machine.dry:
            return True
        if self.machine.too_cold:
            self.machine.say(self.too_cold_words)
            return True
        if travel_mm > _LONGEST_EXTRUSION_MM:
            self.machine.say("echo: too long extrusion prevented")
            return True
        return False

    def _begin(self, steps: Steps, answers: bool = True) -> None:
        """Do what is to be done at once, and keep the rest as a task.

        ``answers`` tells the command in hand, which ends with an ok, from a quickstop between.
        """
        if steps is not None:
            self._resume(steps, answers)
        elif answers:
            self._end_command()

    def _resume(self, task: Task, answers: bool) -> None:
        """Run a task up to a wait that isn't over yet."""
        wait = next(task, None)
        while wait is not None and not self.machine.dead and wait.done(self.machine):
            wait = next(task, None)
        if self.machine.dead:
            return
        if wait is not None:
            self._tasks.append((task, wait, answers))
        elif answers:
            self._end_command()

    def _end_command(self) -> None:
        """Answer the command in hand and take it off the queue."""
        if self.machine.dead:
            return
        if not self._answered:
            self._say_advanced_ok() if self.machine.printer.advanced_ok else self.say_ok()
        self._queue.popleft()
        self._busy_at = math.inf
        if _SYNC.match(self._command):
            self.synced += 1

    def _say_advanced_ok(self) -> None:
        """The answer with line number, free planner blocks and free places in the queue."""
        self.say_ok(advanced_ok(self.machine, self._command, len(self._queue)))

    def _forget(self) -> None:
        self._queue.clear()
        self._tasks.clear()
        self.wire.clear()
        self.plan.muted.clear()
        self._hush = False
        self._busy_at = math.inf
