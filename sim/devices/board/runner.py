"""Run a simulated board's commands: start one, wait until it is done, reply."""

from __future__ import annotations

import math
import re
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sim.devices.board.controller import Controller
from sim.devices.board.waits import Steps, Task, WaitFreeSlot, WaitStandstill, WaitUntil
from sim.gcode.motion.hardware import BLOCK_S, CORNER_S, TRAPEZOID_S
from sim.gcode.motion.state import Records
from sim.gcode.program.gcode import Command, command_of, split_line
from sim.gcode.program.modal import ARC, BAD, arc_points, interpret, speed

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


# Execute G0 to G3 (straight moves, arcs) and G92 on a simulated board.

LONGEST_EXTRUSION_MM: Final = 200.0
"""As Marlin is built; no other twin's own is known."""
ARC_PIECE_S: Final = BLOCK_S + CORNER_S + 2 * TRAPEZOID_S
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
        yield WaitFreeSlot()
        machine.move_to(point, feed, board.work.job_line)
        if len(points) > 1:
            yield WaitUntil(machine.now + ARC_PIECE_S)
    machine.idle_since = machine.now


def _no_extrusion(board: Controller, travel_mm: float) -> bool:
    """Whether the firmware drops the plunger's part of a move; it says why, but for a dry run."""
    machine = board.machine
    if machine.dry:
        return True
    if machine.too_cold:
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
    """G92: give the position other numbers; nothing moves and nothing is said."""
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
    yield WaitStandstill()
    shift = motion.tool_offset[number] - motion.tool_offset[motion.tool]
    interpret(motion.modal[0], board.words[0])
    board.machine.use_head(number)
    motion.modal["shift"][0] += shift
