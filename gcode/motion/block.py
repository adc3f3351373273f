"""Compute a planner block from a move: steps, speed and acceleration limits, junction speed.

Speeds and lengths are 32-bit floats, as they are in the firmware.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcode.motion.state import Record
from kernels import jit


class StepTimer(NamedTuple):
    """Timer of the stepper interrupt on an 8-bit board."""

    ticks_per_s: int = 2_000_000
    slowest: int = 32  # Least rate, events/s, at which the 16-bit timer doesn't overflow.
    least_rate: int = 32  # Least rate of a trapezoid's ends, events/s.
    # Events/s above which one interrupt gives two pulses, then four and so on.
    single_rate: int = 10_000
    period_extra: int = 1  # Ticks that the timer adds to each interval.
    no_limit: int = 1 << 62


TIMER: Final = StepTimer()


F = np.float32
Single = np.float32 | float
"""A 32-bit float inside the kernels."""


@jit
def to_steps(target_mm: float, steps_per_mm: float) -> int:
    """Nearest step of a target, rounded as a 32-bit firmware float is; halves away from zero."""
    scaled = F(target_mm) * F(steps_per_mm)
    steps = math.floor(abs(scaled) + 0.5)
    return steps if scaled >= 0 else -steps


@jit
def reachable_sq(speed_sq: Single, acceleration: Single, distance: Single) -> Single:
    """v² + 2 a s, (mm/s)²."""
    return F(F(speed_sq) + F(2) * F(acceleration) * F(distance))


@jit
def fill(planner: Record, block: Record, target: NDArray[np.int64]) -> bool:
    """Size of a block: steps, events, path length. False when it is below the least steps."""
    events = 0
    path_steps = 0
    square = F(0)
    for axis in range(4):
        steps = target[axis] - planner.position[axis]
        if axis == 3 and planner.flow != 1:
            steps = math.floor(abs(steps * planner.flow) + 0.5) * (1 if steps > 0 else -1)
        block.steps[axis] = steps
        block.unit[axis] = F(steps) * planner.mm_per_step[axis]
        events = max(events, abs(steps))
        if axis < 3:
            path_steps = max(path_steps, abs(steps))
            square += block.unit[axis] * block.unit[axis]
    block.events = events
    if path_steps < planner.min_steps:
        block.millimetres = abs(block.unit[3])
    else:
        block.millimetres = np.sqrt(square)
    return events >= planner.min_steps


@jit
def set_speeds(planner: Record, block: Record, feed: float, waiting: int, half: int) -> None:
    """Nominal speed and rate: the feed, lowered by each axis's limit.

    While 2 to ``half - 1`` blocks are waiting, a segment shorter than the least segment time is
    stretched, so that the ring doesn't run empty at full speed.
    """
    per_s = F(feed) / block.millimetres
    if 2 <= waiting < half:
        time_us = math.floor(1e6 / per_s + 0.5)
        missing = int(planner.min_segment_us) - time_us
        if missing > 0:
            per_s = F(1e6 / (time_us + 2 * missing // waiting))
            planner.starved = True
    factor = F(1)
    for axis in range(4):
        wanted = abs(block.unit[axis] * per_s)
        if wanted > planner.max_speed[axis]:
            factor = min(factor, planner.max_speed[axis] / wanted)
    rate = math.ceil(F(block.events) * per_s)
    block.nominal_speed = block.millimetres * per_s * factor
    block.nominal_rate = max(int(F(rate) * factor), TIMER.least_rate)


@jit
def set_acceleration(planner: Record, block: Record) -> None:
    """Acceleration along the path, lowered until each axis keeps its own limit."""
    block.steps_per_mm = F(block.events) / block.millimetres
    sort = 0 if block.steps[3] != 0 else 2
    if block.steps[0] == 0 and block.steps[1] == 0 and block.steps[2] == 0:
        sort = 1
    rate = math.ceil(planner.acceleration[sort] * block.steps_per_mm)
    for axis in range(4):
        size = abs(block.steps[axis])
        if size > 0:
            limit = int(planner.max_acceleration[axis] * planner.steps_per_mm[axis])
            rate = min(rate, limit * block.events // size)
    block.acceleration_rate = rate
    block.acceleration = F(rate) / block.steps_per_mm
    # Mean speed over the first step from rest, the slowest that the stepper can do in one.
    slowest = F(0.5) * block.acceleration / block.steps_per_mm
    block.least_sq = min(slowest, block.nominal_speed * block.nominal_speed)


@jit
def set_direction(block: Record) -> None:
    """Turn the block's displacement into a unit vector; E counts where the plunger moves."""
    square = F(0)
    for axis in range(4 if block.steps[3] != 0 else 3):
        square += block.unit[axis] * block.unit[axis]
    scale = F(1) / np.sqrt(square)
    for axis in range(4):
        block.unit[axis] *= scale


@jit
def junction_sq(planner: Record, before: Record, block: Record) -> Single:
    """Square of the speed with which a block may be entered from ``before``, (mm/s)².

    Junction deviation (Sonny Jeon's centripetal model, as in Grbl and Marlin), with Marlin's
    rule for small segments: below 1 mm and with less than 45° of turn the corner stands for an
    arc of the segment's length over that turn.
    """
    cosine = F(0)
    square = F(0)
    for axis in range(4):
        cosine -= before[axis] * block.unit[axis]
        square += (block.unit[axis] - before[axis]) ** 2
    if cosine > F(0.999999):
        return block.least_sq
    length = np.sqrt(square)
    limit = block.acceleration
    for axis in range(4):
        share = abs(block.unit[axis] - before[axis]) / length
        if share > 0 and limit * share > planner.max_acceleration[axis]:
            limit = planner.max_acceleration[axis] / share
    cosine = max(cosine, F(-0.999999))
    half_sine = np.sqrt(F(0.5) * (F(1) - cosine))
    speed_sq = limit * planner.junction_deviation * half_sine / (F(1) - half_sine)
    if block.millimetres < 1 and cosine < F(-0.70710678):
        speed_sq = min(speed_sq, block.millimetres * limit / turn_angle(cosine))
    return speed_sq


@jit
def turn_angle(cosine: Single) -> Single:
    """acos(-cosine), by W. R. Franklin's minimax polynomial of the arcsine, within 0.033."""
    sign = F(-1) if cosine < 0 else F(1)
    t = sign * F(cosine)
    arcsine = F(84.31466202)
    arcsine = arcsine * t + F(-242.7199627)
    arcsine = arcsine * t + F(262.8130562)
    arcsine = arcsine * t + F(-131.1123477)
    arcsine = arcsine * t + F(29.66153956)
    arcsine = arcsine * t + F(-1.451838349)
    arcsine = arcsine * t + F(0.032843707)
    return F(1.5707963) + sign * arcsine
