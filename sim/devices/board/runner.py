"""Run a simulated board's commands: start one, wait until it is done, reply."""

from __future__ import annotations

import math
import re
from typing import Final

from sim.devices.board.controller import Controller
from sim.devices.board.waits import Steps, Task
from sim.gcode.program.gcode import Command, command_of, split_line

_SYNC: Final = re.compile(rb"(?:N[-0-9]*)? *M0*400(?!\d)")


class Runner:
    """Runs one command after the other; something urgent may come between.

    Parameters
    ----------
    board : Controller
    """

    def __init__(self, board: Controller) -> None:
        self._board = board

    def start(self) -> None:
        """Take the oldest command of the queue in hand."""
        board, work, machine = self._board, self._board.work, self._board.machine
        line = work.queue[0]
        machine.now += machine.command_s()
        machine.roll()
        work.line, work.answered = line, False
        split_line(line, board.words)
        command = command_of(line, board.words)
        work.mute |= board.plan.is_mute(command.line_number)
        work.job_line = board.job.take(line) if board.job else (command.line_number or 0) - 1
        keepalive = machine.reports.keepalive_s
        work.busy_at = machine.now + keepalive if keepalive > 0 else math.inf
        board.firmware.echo(line)
        self.begin(self._steps(command))

    def _steps(self, command: Command) -> Steps:
        gauge = self._board.gauges.get(f"{command.letter}{command.number}")
        if gauge is None:
            return self._board.firmware.start(command)
        self._board.machine.say(gauge.at(self._board.machine.now))
        return None

    def begin(self, steps: Steps, answers: bool = True) -> None:
        """Do what is to be done at once, and keep the rest as a task.

        ``answers`` tells the command in hand, which ends with an ok, from a quickstop between.
        """
        if steps is not None:
            self._resume(steps, answers)
        elif answers:
            self._end()

    def go_on(self) -> bool:
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
