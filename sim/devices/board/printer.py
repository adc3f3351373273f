"""Base class of simulated printers: bytes in, bytes out, in virtual time, no I/O.

Modelled of any board, whatever its firmware:

- the serial line: bytes take their time at the baud rate, both ways; a receive ring that overruns;
  a command queue from which ``ok`` comes when a command is done (a move is done when it is in the
  planner); line assembly with comments and overlong lines;
- planner, stepper and their times (`gcode.motion.planner`), step counters, G92 as a shift of
the
  workspace; heaters with thermal mass; settings that are stored;
- planned faults (`sim.devices.faults`), and a bad cable
  (`sim.devices.faults`) for whoever owns the port.

What a firmware does with that is its family's (`sim.devices.board.controller`,
`sim/devices/families/`).

Not modelled: SD card, display, probe, a mesh (levelling knows a slope), endstops that are hit
(G28 is a straight run to the low end, and a switch fails only as a fault says), a head's own
temperature where there are several, sensors' noise, heaters' control loop, bytes that the line
invents, the stutter of an overloaded processor, motors that lose steps. The software endstops
count only on axes that were homed: a machine that wasn't homed runs to any place commanded, and the
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
import re
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcode.motion.executed import ExecutedMotion
from gcode.motion.state import PLANNING, Records
from gcode.program.gcode import command_of, split_line
from gcode.program.modal import ARC, BAD, arc_points, interpret, speed
from sim.devices.board.controller import Controller, apply_fault
from sim.devices.board.machine import FREE_SLOT, STANDSTILL, Steps, Task, wait_until
from sim.devices.board.wire import RefusedLine

_LOOK_S: Final = 1e-4
"""From the end of a quickstop until the next urgent code is looked at: a line that waited is let in
first, and dropped before its first step (Marlin's `Temperature::task` isn't entered twice)."""
_SYNC: Final = re.compile(rb"(?:N[-0-9]*)? *M0*400(?!\d)")


class MainLoop:
    """Brings a board's parts on in the order of time, as the firmware's own loop does.

    It looks into the receive ring, queues lines, says what is due, takes the oldest command in
    hand, and waits for what that waits for. The clock jumps from one event to the next.
    """

    def __init__(self, board: Controller) -> None:
        self._board = board
        self.wakes_s = 0.0
        """When it next has something to do by itself, s; infinity where only the host can go on."""

    @property
    def pending(self) -> bool:
        """Whether a line is on its way, in line or in hand."""
        wire = self._board.wire
        return not self._board.work.idle or not wire.quiet or bool(wire.urgent)

    def run(self, until: float) -> None:
        """Work until ``until``, s, or until only the host can go on."""
        board, machine, wire = self._board, self._board.machine, self._board.wire
        settles = math.isinf(until)
        while machine.now <= until:
            wire.deliver(machine.now)
            stalled = machine.now < machine.stalled_until
            halts_at = self._halt_when_due()
            if machine.dead:
                board.firmware.hear_dead()
            elif not stalled and self._step():
                continue
            at = wire.next_arrival()
            arrives = math.inf if at is None else at
            if stalled:
                soon = machine.stalled_until
            elif machine.dead:
                soon = min(arrives, math.inf if settles else halts_at)
            elif settles and not self.pending:
                return
            else:
                soon = min(self.next_alarm_s(), arrives, self._task_at())
                if wire.urgent:  # not looked at while a quickstop goes on
                    soon = min(soon, machine.motion.closed_until + _LOOK_S)
            self.wakes_s = soon
            if math.isinf(soon) or soon > until:
                return
            if settles and at is None and math.isinf(self._task_at()):
                return
            machine.now = max(machine.now, soon)

    def _halt_when_due(self) -> float:
        """Stop the motors of a killed board if it is time; else when to look again, s."""
        machine = self._board.machine
        if machine.halts_s is None:
            return math.inf
        due = machine.halts_s()
        if machine.now < due:
            return due
        machine.motion.stop(machine.now)
        machine.halts_s = None
        return math.inf

    def _task_at(self) -> float:
        tasks = self._board.work.tasks
        return tasks[-1][1].at(self._board.machine) if tasks else math.inf

    def _step(self) -> bool:
        """Do one thing that is due now; False when nothing is."""
        board, machine, wire = self._board, self._board.machine, self._board.wire
        machine.roll()
        if wire.urgent and machine.now > machine.motion.closed_until:
            self._read_line()  # it is looked at before the flag that the interrupt has set
            codes = sorted(set(wire.urgent))  # flags; M112 is looked at before M410
            wire.urgent.clear()
            for code in codes:
                if not machine.dead:
                    self._begin(board.firmware.act_urgently(code), answers=False)
            return True
        if (fault := board.plan.due(machine.now, wire.received)) is not None:
            apply_fault(board, fault)
            return True
        if machine.now >= self.next_alarm_s():
            self._sound_alarms()
            return True
        if self._read_line():
            return True
        if board.work.tasks:
            return self._go_on()
        if board.work.queue:
            self._start()
            return True
        return False

    # -- from the receive ring to the command queue

    def _read_line(self) -> bool:
        """Move one line from the ring to the queue, or refuse it; whether there was one."""
        board = self._board
        board.firmware.look_at(board.wire.ring)
        if len(board.work.queue) >= board.machine.printer.command_queue:
            return False
        line = board.reader.next_line(board.wire.ring)
        if line is None:
            return False
        before = board.lines.last_number
        accepted = board.lines.accept(line)
        if isinstance(accepted, RefusedLine):
            board.firmware.refuse(accepted.reason)
        elif accepted is not None:
            self._take(accepted, before)
        return True

    def _take(self, line: bytes, last_number: int) -> None:
        board = self._board
        number = board.lines.last_number
        fault = board.plan.at_line(number) if number != last_number else None
        if fault is not None and apply_fault(board, fault):
            return
        board.work.queue.append(line)
        code = board.firmware.urgent_code(line)
        if code is not None:
            self._begin(board.firmware.act_urgently(code), answers=False)

    # -- heaters' faults, busy messages, reports and the idle limit

    def next_alarm_s(self) -> float:
        """When it next has something to say or do of its own, s."""
        machine, work = self._board.machine, self._board.work
        reports = machine.reports
        soon = min(reports.temperature.next_at, reports.position.next_at, machine.heat.alarm()[0])
        soon = min(soon, self._board.plan.next_s)
        if work.tasks:
            soon = min(soon, work.busy_at)
        if machine.idle_limit_s > 0:
            soon = min(soon, self._idle_deadline())
        return soon

    def _idle_deadline(self) -> float:
        machine, motion = self._board.machine, self._board.machine.motion
        # It watches over the host, whose signs of life come by a clock that nothing speeds up.
        limit_s = machine.idle_limit_s * (1.0 if self._board.work.tasks else machine.host_pace)
        if motion.blocks:
            return max(motion.next_event(), machine.now) + limit_s
        return max(machine.idle_since, float(motion.planner["run_end"][0])) + limit_s

    def _sound_alarms(self) -> None:
        board, machine, work = self._board, self._board.machine, self._board.work
        firmware, reports = board.firmware, machine.reports
        now = machine.now
        heat_at, heat_fault = machine.heat.alarm()
        if now >= heat_at:
            firmware.fail_heat(heat_fault)
            return
        if work.tasks and now >= work.busy_at:
            firmware.say_busy(work.tasks[-1][1])
            work.busy_at = now + reports.keepalive_s
        for report, say in (
            (reports.temperature, firmware.report_temperatures),
            (reports.position, firmware.report_position),
        ):
            if now >= report.next_at:
                say()
                report.next_at += report.every_s
        if machine.idle_limit_s > 0 and now >= self._idle_deadline():
            firmware.idle_is_over()

    # -- commands, one after the other; something urgent may come between

    def _start(self) -> None:
        """Take the oldest command of the queue in hand."""
        board, work, machine = self._board, self._board.work, self._board.machine
        line = work.queue[0]
        machine.now += machine.motion.command_s(machine.now)
        machine.roll()
        work.line, work.answered = line, False
        split_line(line, board.words)
        command = command_of(line, board.words)
        work.mute |= board.plan.is_mute(command.line_number)
        work.job_line = board.job.take(line) if board.job else (command.line_number or 0) - 1
        keepalive = machine.reports.keepalive_s
        work.busy_at = machine.now + keepalive if keepalive > 0 else math.inf
        board.firmware.echo(line)
        gauge = board.gauges.get(command.name)
        if gauge is None:
            self._begin(board.firmware.start(command))
        else:
            machine.say(gauge.at(machine.now))
            self._begin(None)

    def _begin(self, steps: Steps, answers: bool = True) -> None:
        """Do what is to be done at once, and keep the rest as a task.

        ``answers`` tells the command in hand, which ends with an ok, from a quickstop between.
        """
        if steps is not None:
            self._resume(steps, answers)
        elif answers:
            self._end()

    def _go_on(self) -> bool:
        """Resume the newest task if its wait is over; whether it was."""
        tasks = self._board.work.tasks
        task, wait, answers = tasks[-1]
        if not wait.done(self._board.machine):
            return False
        tasks.pop()
        self._resume(task, answers)
        return True

    def _resume(self, task: Task, answers: bool) -> None:
        """Run a task up to a wait that isn't over yet."""
        machine = self._board.machine
        wait = next(task, None)
        while wait is not None and not machine.dead and wait.done(machine):
            wait = next(task, None)
        if machine.dead:
            return
        if wait is not None:
            self._board.work.tasks.append((task, wait, answers))
        elif answers:
            self._end()

    def _end(self) -> None:
        """Answer the command in hand and take it off the queue."""
        board, work = self._board, self._board.work
        if board.machine.dead:
            return
        if not work.answered:
            board.say_ok(board.firmware.ok_words())
        work.queue.popleft()
        work.busy_at = math.inf
        if _SYNC.match(work.line):
            board.synced += 1


class SimulatedPrinter(Controller):
    """A board and the loop that brings it on; a family's class adds `firmware_class`, no more.

    Parameters and attributes are those of `sim.devices.board.controller.Controller`.
    """

    @cached_property
    def _loop(self) -> MainLoop:
        return MainLoop(self)

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
        """Return the printer's output since the last call."""
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
        return self.machine.motion.executed(self.now)


LONGEST_EXTRUSION_MM: Final = 200.0
"""As Marlin is built; no other twin's own is known."""
ARC_PIECE_S: Final = PLANNING.block_s + PLANNING.corner_s + 2 * PLANNING.trapezoid_s
"""Between two pieces of an arc: an 8-bit board's time to plan one."""


def move(board: Controller) -> Task:
    """Make the move of the command in hand, when the planner has a place for it."""
    machine, firmware = board.machine, board.firmware
    motion = machine.motion
    begin = motion.modal["position"][0].copy()
    kind = interpret(motion.modal[0], board.words[0])
    target = motion.modal["position"][0].copy()
    points = target[None]
    if kind == ARC:
        points = arc_of(begin, target, board.words, float(motion.modal["unit"][0]))
    if kind == BAD or not len(points):
        motion.modal["position"][0] = begin
        machine.say(firmware.bad_arc_words)
        return
    if target[3] != begin[3] and _no_extrusion(board, abs(target[3] - begin[3])):
        motion.set_plunger(float(target[3]))
    motion.modal["position"][0] = points[-1]
    feed = float(speed(motion.modal[0]))
    for point in points:
        yield FREE_SLOT
        machine.move_to(point, feed, board.work.job_line)
        if len(points) > 1:
            yield wait_until(machine.now + ARC_PIECE_S)
    machine.idle_since = machine.now


def _no_extrusion(board: Controller, travel_mm: float) -> bool:
    """Whether the firmware drops the plunger's part of a move; it says why, but for a dry run."""
    machine = board.machine
    if machine.dry:
        return True
    if machine.heat.too_cold(machine.now):
        machine.say(board.firmware.too_cold_words)
        return True
    if travel_mm > LONGEST_EXTRUSION_MM:
        machine.say(board.firmware.too_long_words)
        return True
    return False


def arc_of(
    begin: NDArray[np.float64], target: NDArray[np.float64], words: Records, unit: float
) -> NDArray[np.float64]:
    """Ends of the arc's pieces, (n, 4), mm; none where it has no centre."""
    points = np.empty((256, 4))
    count = arc_points(begin, target, words[0], unit, points)
    if count > len(points):
        points = np.empty((count, 4))
        arc_points(begin, target, words[0], unit, points)
    return begin[None] if count < 0 else points[:count]


def set_position(board: Controller) -> None:
    """G92: give the position other numbers; nothing moves, nothing is answered."""
    motion = board.machine.motion
    before = float(motion.modal["position"][0, 3])
    interpret(motion.modal[0], board.words[0])
    after = float(motion.modal["position"][0, 3])
    if after != before:
        motion.set_plunger(after)


def take_tool_in_silence(board: Controller, number: int) -> Task:
    """Use another head once the motors stand.

    The place keeps its name for the carriage; what the user calls it shifts by the offsets.
    """
    motion = board.machine.motion
    yield STANDSTILL
    shift = motion.tool_offset[number] - motion.tool_offset[motion.tool]
    interpret(motion.modal[0], board.words[0])
    board.machine.motion.use_head(number, board.machine.now)
    motion.modal["shift"][0] += shift
