"""Execute G0 to G3 (straight moves, arcs) and G92 on a simulated board."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from sim.devices.board.controller import Controller
from sim.devices.board.waits import Task, WaitFreeSlot, WaitUntil
from sim.gcode.motion.hardware import BLOCK_S, CORNER_S, TRAPEZOID_S
from sim.gcode.motion.state import Records
from sim.gcode.program.modal import ARC, BAD, arc_points, interpret, speed

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
