"""Main loop of the simulated board: read lines, run commands, wait, report; in virtual time.

One loop as the firmware has it: look into the receive ring, queue lines, say what is due, take
the oldest command in hand, wait for what it waits for. The clock jumps from one event to the
next.
"""

from __future__ import annotations

import math

from sim.devices.board.controller import Controller, apply_fault
from sim.devices.board.runner import Runner
from sim.devices.board.wire import RefusedLine

_LOOK_S = 1e-4
"""From the end of a quickstop until the next urgent code is looked at: a line that waited is let in
first, and dropped before its first step (Marlin's `Temperature::task` isn't entered twice)."""


class MainLoop:
    """Brings a board's parts on in the order of time.

    Parameters
    ----------
    board : Controller
    """

    def __init__(self, board: Controller) -> None:
        self._board = board
        self._runner = Runner(board)
        self._intake = Intake(board, self._runner)
        self._alarms = Alarms(board)
        self.wakes_s = 0.0
        """When it next has something to do by itself, s; infinity where only the host can go on."""

    @property
    def pending(self) -> bool:
        """Whether a line is on its way, in line or in hand."""
        wire = self._board.wire
        return not self._board.work.idle or not wire.quiet or bool(wire.urgent)

    def next_alarm_s(self) -> float:
        """When it next has something to say or do of its own, s."""
        return self._alarms.next_s()

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
                soon = min(self._alarms.next_s(), arrives, self._task_at())
                if wire.urgent:  # not looked at while a quickstop goes on
                    soon = min(soon, machine.motion.closed_until + _LOOK_S)
            self.wakes_s = soon
            if math.isinf(soon) or soon > until:
                return
            if settles and at is None and self._waits_for_host():
                return
            machine.now = max(machine.now, soon)

    def _halt_when_due(self) -> float:
        """Stop the motors of a killed board if it is time; else when to look again, s."""
        machine = self._board.machine
        if machine.run_on is None:
            return math.inf
        due = machine.run_on.ends_s()
        if machine.now < due:
            return due
        machine.stop()
        machine.run_on = None
        return math.inf

    def _waits_for_host(self) -> bool:
        """Whether the present wait ends by no clock, or nothing at all is being done."""
        return not self._board.work.tasks or math.isinf(self._task_at())

    def _task_at(self) -> float:
        tasks = self._board.work.tasks
        return tasks[-1][1].at(self._board.machine) if tasks else math.inf

    def _step(self) -> bool:
        """Do one thing that is due now; False when nothing is."""
        board, machine, wire = self._board, self._board.machine, self._board.wire
        machine.roll()
        if wire.urgent and machine.now > machine.motion.closed_until:
            self._intake.read_line()  # it is looked at before the flag that the interrupt has set
            if wire.urgent:
                codes = sorted(set(wire.urgent))  # flags; M112 is looked at before M410
                wire.urgent.clear()
                for code in codes:
                    if not machine.dead:
                        self._intake.act_urgently(code)
            return True
        if (fault := board.plan.due(machine.now, wire.received)) is not None:
            apply_fault(board, fault)
            return True
        if machine.now >= self._alarms.next_s():
            self._alarms.sound()
            return True
        if self._intake.read_line():
            return True
        if board.work.tasks:
            return self._runner.go_on()
        if board.work.queue:
            self._runner.start()
            return True
        return False


# Admit lines to a simulated board: from the receive ring to the command queue, or refused.


class Intake:
    """Takes lines while the queue has room.

    Parameters
    ----------
    board : Controller
    runner : Runner
        Of what acts as it enters.
    """

    def __init__(self, board: Controller, runner: Runner) -> None:
        self._board, self._runner = board, runner

    def read_line(self) -> bool:
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
            self.act_urgently(code)

    def act_urgently(self, code: bytes) -> None:
        """Have the firmware do what an urgent code asks for, before the command in hand goes on."""
        self._runner.begin(self._board.firmware.act_urgently(code), answers=False)


# Timed events of a simulated board: heater faults, busy messages, reports, idle timeout.


class Alarms:
    """Heaters' faults, busy messages, reports and the idle limit.

    Parameters
    ----------
    board : Controller
    """

    def __init__(self, board: Controller) -> None:
        self._board = board

    def next_s(self) -> float:
        """When the main loop next has something to say or do of its own, s."""
        machine, work = self._board.machine, self._board.work
        reports = machine.reports
        soon = min(reports.temperature_at, reports.position_at, machine.heat.alarm().at)
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

    def sound(self) -> None:
        """Say and do all that is due now."""
        board, machine, work = self._board, self._board.machine, self._board.work
        firmware, reports = board.firmware, machine.reports
        now = machine.now
        heat = machine.heat.alarm()
        if now >= heat.at:
            firmware.fail_heat(heat.fault)
            return
        if work.tasks and now >= work.busy_at:
            firmware.say_busy(work.tasks[-1][1])
            work.busy_at = now + reports.keepalive_s
        if now >= reports.temperature_at:
            firmware.report_temperatures()
            reports.temperature_at += reports.temperature_s
        if now >= reports.position_at:
            firmware.report_position()
            reports.position_at += reports.position_s
        if machine.idle_limit_s > 0 and now >= self._idle_deadline():
            firmware.idle_is_over()
