"""Main loop of the simulated board: read lines, run commands, wait, report; in virtual time.

One loop as the firmware has it: look into the receive ring, queue lines, say what is due, take
the oldest command in hand, wait for what it waits for. The clock jumps from one event to the
next.
"""

from __future__ import annotations

import math

from sim.devices.board.alarms import Alarms
from sim.devices.board.controller import Controller
from sim.devices.board.fault_effects import apply_fault
from sim.devices.board.intake import Intake
from sim.devices.board.runner import Runner


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
        return not self._board.work.idle or not self._board.wire.quiet

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
        if wire.urgent:
            self._intake.read_line()  # it is looked at before the flag that the interrupt has set
            if wire.urgent:
                self._intake.act_urgently(wire.urgent.pop(0))
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
