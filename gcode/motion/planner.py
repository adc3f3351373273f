"""Marlin's motion planner: a ring buffer of blocks with lookahead, in virtual time.

What is modelled, after Marlin 2.1 with junction deviation: rounding of targets to whole steps in
32-bit floats, merging of moves below the least steps, limits of speed and acceleration per axis,
slowing down of short segments while the ring is nearly empty, junction speeds with the rule for
small segments and each block's least speed, reverse and forward passes, trapezoids from step
counts, the wait of an idle stepper for a third block or 100 looks of 1 ms, and pulse times as the
stepper's interrupt gives them (`gcode.motion.planner`).

What isn't: S-curves, linear advance, input shaping, classic jerk, backlash correction, an arc's
own hints, the processor's load (a real 8-bit board stutters above some 20,000 events/s).
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcode.motion.block import (
    TIMER,
    fill,
    junction_sq,
    reachable_sq,
    set_acceleration,
    set_direction,
    set_speeds,
    to_steps,
)
from gcode.motion.state import Record, Records
from kernels import jit


@jit
def timer_interval(rate: int) -> int:
    """Ticks that the table of the 8-bit boards gives for ``rate`` events/s.

    The interrupt of an 8-bit board runs on a 16-bit timer at 2 MHz. After each pulse it works out
    the rate of the next one from the time spent accelerating so far and turns it into a timer
    interval by a table of two parts, interpolated linearly (fine above 2048 events/s, coarse
    below). In the timer's clear-on-compare mode a period is one tick longer than its compare value.
    """
    if rate <= TIMER.slowest:
        return TIMER.ticks_per_s // TIMER.slowest
    above = rate - TIMER.slowest
    if above >= 2048:
        base = TIMER.ticks_per_s // (TIMER.slowest + (above & ~255))
        gain = base - TIMER.ticks_per_s // (TIMER.slowest + (above & ~255) + 256)
        return base - ((gain * (above & 255)) >> 8)
    base = TIMER.ticks_per_s // (TIMER.slowest + (above & ~7))
    gain = base - TIMER.ticks_per_s // (TIMER.slowest + (above & ~7) + 8)
    return base - ((gain * (above & 7)) >> 3)


@jit
def pulses_per_interrupt(rate: int) -> int:
    """Pulses of one interrupt at ``rate`` events/s: a power of two, at most 16."""
    pulses = 1
    while pulses < 16 and rate > TIMER.single_rate * pulses:
        pulses *= 2
    return pulses


@jit
def walk(block: Record, ticks_left: int) -> tuple[int, int, int]:
    """Step a block through its trapezoid until it ends or ``ticks_left`` run out.

    Parameters
    ----------
    block : record of `BLOCK`
        Its trapezoid must be final.
    ticks_left : int
        Stop before the pulse that would come later than this; negative for no limit.

    Returns
    -------
    events : int
        Step events done.
    ticks : int
        From the block's start to its last pulse.
    first : int
        From the block's start to its first pulse.
    """
    # One loop, as the interrupt is one: its phases share nine running values, so that any part
    # taken out would have to be given, and give back, nearly all of them.
    limit = ticks_left if ticks_left >= 0 else TIMER.no_limit
    # Rates in 24-bit fixed point per tick, as the interrupt multiplies them.
    slope = int(block.acceleration_rate * (16777216.0 / TIMER.ticks_per_s))
    rate = block.initial_rate
    peak = rate
    pulses = pulses_per_interrupt(rate)
    interval = timer_interval(rate // pulses)
    accelerating = interval // 2
    decelerating = interval // 2
    first = interval + TIMER.period_extra
    ticks = 0
    events = 0
    cruise = 0
    cruise_pulses = 1
    while True:
        if ticks + interval + TIMER.period_extra > limit:
            return events, ticks, first
        ticks += interval + TIMER.period_extra
        events += pulses
        if events >= block.events:
            return block.events, ticks, first
        if events < block.accelerate_before:
            peak = min(((accelerating * slope) >> 24) + block.initial_rate, block.nominal_rate)
            pulses = pulses_per_interrupt(peak)
            interval = timer_interval(peak // pulses)
            accelerating += interval
            decelerating = 0
        elif events >= block.decelerate_start:
            loss = (decelerating * slope) >> 24
            rate = max(peak - loss, block.final_rate)
            pulses = pulses_per_interrupt(rate)
            interval = timer_interval(rate // pulses)
            decelerating += interval
        else:
            if cruise == 0:
                peak = block.nominal_rate
                cruise_pulses = pulses_per_interrupt(peak)
                cruise = timer_interval(peak // cruise_pulses)
                decelerating = cruise // 2
            pulses = cruise_pulses
            interval = cruise
            # All interrupts of the plateau but its last one take the same time: skip them.
            skip = (block.decelerate_start - events - 1) // pulses
            skip = min(skip, (limit - ticks) // (interval + TIMER.period_extra))
            if skip > 0:
                ticks += skip * (interval + TIMER.period_extra)
                events += skip * pulses


@jit
def axis_steps(steps: int, events: int, done: int) -> int:
    """Steps of one axis after ``done`` of a block's ``events``: Bresenham from one half."""
    size = abs(steps)
    taken = (2 * size * done + events) // (2 * events)
    return taken if steps >= 0 else -taken


class IdleStepper(NamedTuple):
    """When an idle stepper takes a block."""

    look_s: float = 1e-3  # An idle stepper's time between two looks for a block.
    # Looks for which an idle stepper waits for company before it takes a single block.
    first_block_looks: int = 100
    company: int = 3  # Blocks that make an idle stepper start at once.


IDLE: Final = IdleStepper()


@jit
def set_trapezoid(block: Record, entry: float, leave: float) -> None:
    """Events of acceleration, plateau and deceleration between two speeds, mm/s.

    An ``entry`` of 0 keeps the rate at which the block begins.
    """
    initial = block.initial_rate
    if entry > 0:
        initial = math.floor(entry * block.steps_per_mm + 0.5)
    initial = max(initial, TIMER.least_rate)
    final = max(math.floor(leave * block.steps_per_mm + 0.5), TIMER.least_rate)
    nominal_sq = float(block.nominal_rate) * block.nominal_rate
    half_inverse = 0.5 / block.acceleration_rate
    up = half_inverse * (nominal_sq - float(initial) * initial)
    down = half_inverse * (nominal_sq - float(final) * final)
    accelerate = math.ceil(up)
    decelerate = math.ceil(down)
    if accelerate + decelerate > block.events:
        accelerate = math.floor((block.events + up - down) * 0.5 + 0.5)
        accelerate = min(max(accelerate, 0), block.events)
        decelerate = block.events - accelerate
    block.initial_rate = initial
    block.final_rate = final
    block.accelerate_before = accelerate
    block.decelerate_start = block.events - decelerate


@jit
def _reverse_pass(planner: Record, ring: Records, safe_exit_sq: float) -> None:
    """Raise entry speeds from the newest block back, as far as each can still brake.

    The first block that isn't running keeps its entry: the one before it ends at that speed.
    """
    exit_sq = safe_exit_sq
    fixed = 1 if planner.running else 0
    for age in range(planner.count - 1, fixed, -1):
        block = ring[(planner.tail + age) % len(ring)]
        allowed = min(
            reachable_sq(exit_sq, block.acceleration, block.millimetres), block.max_entry_sq
        )
        if block.entry_sq == block.max_entry_sq or allowed == block.entry_sq:
            return
        block.entry_sq = allowed
        block.recalculate = True
        exit_sq = allowed


@jit
def _limit_entry(before: Record, block: Record) -> None:
    """Lower an entry speed that the block before can't accelerate to, and hold it for good."""
    if block.entry_sq != block.min_entry_sq:
        if before.entry_sq < block.entry_sq:
            reachable = reachable_sq(before.entry_sq, before.acceleration, before.millimetres)
            if reachable < block.entry_sq:
                block.entry_sq = max(reachable, block.min_entry_sq)
                block.max_entry_sq = block.entry_sq
        block.min_entry_sq = block.entry_sq


@jit
def _set_trapezoids(planner: Record, ring: Records, safe_exit_sq: float) -> None:
    """Go forward over the plan: entry speeds that can be reached, then the trapezoids."""
    entry = 0.0
    for age in range(planner.count):
        block = ring[(planner.tail + age) % len(ring)]
        if not block.recalculate:
            continue
        if age == 0:
            block.entry_sq = block.min_entry_sq
            entry = math.sqrt(block.entry_sq)
            continue
        before = ring[(planner.tail + age - 1) % len(ring)]
        if age == 1 and planner.running:
            block.entry_sq = block.min_entry_sq
            if block.initial_rate == 0:
                block.initial_rate = before.final_rate
            continue
        _limit_entry(before, block)
        entry_before, entry = entry, math.sqrt(block.entry_sq)
        set_trapezoid(before, entry_before, entry)
        before.recalculate = False
        planner.trapezoids += 1
    newest = ring[(planner.tail + planner.count - 1) % len(ring)]
    set_trapezoid(newest, entry, math.sqrt(safe_exit_sq))
    newest.recalculate = False
    planner.trapezoids += 1


@jit
def add_move(
    planner_of: Records,
    ring: Records,
    target_mm: NDArray[np.float64],
    feed: float,
    line: int,
    now: float,
) -> bool:
    """Take a straight move into the ring, which must have a free place.

    Parameters
    ----------
    planner_of : (1,) of `PLANNER`
    ring : (n,) of `BLOCK`
    target_mm : (4,) float64, mm
        Where to, x y z e, in the firmware's native coordinates.
    feed : float, mm/s
        Asked for.
    line : int
        Kept for the log.
    now : float, s
        The printer's time; `run_until` must have been called for it.

    Returns
    -------
    bool
        False where the move has fewer steps than the least and is left to its successor.
    """
    planner = planner_of[0]
    planner.trapezoids = 0
    planner.starved = False
    block = ring[(planner.tail + planner.count) % len(ring)]
    target = np.empty(4, np.int64)
    for axis in range(4):
        target[axis] = to_steps(target_mm[axis], planner.steps_per_mm[axis])
    if not fill(planner, block, target):
        planner.merged += 1 if block.events > 0 else 0
        return False
    waiting = planner.count - (1 if planner.running else 0)
    planner.starved = planner.count == 0
    set_speeds(planner, block, feed, waiting, len(ring) // 2)
    set_acceleration(planner, block)
    set_direction(block)
    block.line = line
    block.max_entry_sq = block.least_sq
    if waiting > 0 and planner.prev_speed > 0:
        corner_sq = min(
            junction_sq(planner, planner.prev_unit, block),
            block.nominal_speed * block.nominal_speed,
            planner.prev_speed * planner.prev_speed,
        )
        # A block is never entered below its least speed, however slow the one before is.
        block.max_entry_sq = max(corner_sq, block.least_sq)
    block.entry_sq = block.least_sq
    block.min_entry_sq = block.least_sq
    block.initial_rate = 0
    block.recalculate = True
    for axis in range(4):
        planner.prev_unit[axis] = block.unit[axis]
        planner.position[axis] = target[axis]
    planner.prev_speed = block.nominal_speed
    if planner.count == 0:
        looks = math.floor((now - planner.run_end) / IDLE.look_s) + IDLE.first_block_looks
        planner.deliver_at = planner.run_end + looks * IDLE.look_s
    planner.count += 1
    _reverse_pass(planner, ring, block.least_sq)
    _set_trapezoids(planner, ring, block.least_sq)
    if planner.count >= IDLE.company:
        planner.deliver_at = min(planner.deliver_at, next_look(planner, now))
    return True


@jit
def next_look(planner: Record, now: float) -> float:
    """When an idle stepper next looks for a block, s: each millisecond from its last one's end."""
    return float(planner.run_end + math.ceil((now - planner.run_end) / IDLE.look_s) * IDLE.look_s)


@jit
def next_event(planner_of: Records) -> float:
    """When the stepper next ends or takes a block, s; infinity where it has nothing to do."""
    planner = planner_of[0]
    if planner.running:
        return planner.run_end
    if planner.count > 0:
        return max(planner.deliver_at, planner.run_end)
    return np.inf


@jit
def command_time(
    planner_of: Records, ring: Records, now: float, costs: NDArray[np.float64]
) -> float:
    """Time that the main thread takes for a command, s: (command + blocks · block) / share.

    Parameters
    ----------
    costs : (5,) float64
        command_s, block_s, interrupt_s, pulse_s and most_load of `gcode.motion.state.Board`.
    """
    seconds = costs[0] + planner_of[0].count * costs[1]
    return seconds / main_share(planner_of, ring, now, costs)


@jit
def main_share(planner_of: Records, ring: Records, now: float, costs: NDArray[np.float64]) -> float:
    """Share of the processor that the stepper's interrupt leaves to the main thread.

    1 - interrupts/s · (interrupt + pulses · pulse), at the rate that the running block's trapezoid
    has at ``now``; ``costs`` as in `command_time`.
    """
    planner = planner_of[0]
    if not planner.running:
        return 1.0
    block = ring[planner.tail]
    up = block.initial_rate + block.acceleration_rate * (now - planner.run_start)
    down = block.final_rate + block.acceleration_rate * (planner.run_end - now)
    rate = max(min(up, down, float(block.nominal_rate)), 0.0)
    pulses = pulses_per_interrupt(int(rate))
    load = rate / pulses * (costs[2] + pulses * costs[3])
    return 1.0 - min(load, costs[4])


@jit
def run_until(planner_of: Records, ring: Records, log: Records, now: float) -> None:
    """Let the stepper run until ``now``, s; the log must have room for all blocks of the ring."""
    planner = planner_of[0]
    while next_event(planner_of) <= now:
        block = ring[planner.tail]
        if planner.running:
            _write_log(planner, block, log, block.events, planner.run_end)
            planner.running = False
            planner.tail = (planner.tail + 1) % len(ring)
            planner.count -= 1
            continue
        planner.run_start = next_event(planner_of)
        _, ticks, first = walk(block, -1)
        if np.isnan(planner.first_pulse):
            planner.first_pulse = planner.run_start + first / TIMER.ticks_per_s
        planner.run_end = planner.run_start + ticks / TIMER.ticks_per_s
        planner.running = True


@jit
def _write_log(planner: Record, block: Record, log: Records, done: int, end: float) -> None:
    """Note the part of a block that ran, and move the motors' counters on."""
    row = log[planner.logged]
    for axis in range(4):
        row.start[axis] = planner.physical[axis]
        planner.physical[axis] += axis_steps(block.steps[axis], block.events, done)
        row.end[axis] = planner.physical[axis]
    row.time_start = planner.run_start
    row.time_end = end
    row.line = block.line
    row.tool = planner.tool
    planner.logged += 1


@jit
def count_steps(planner_of: Records, ring: Records, now: float, out: NDArray[np.int64]) -> int:
    """Physical steps at ``now`` into ``out`` (4,); returns events done of the running block."""
    planner = planner_of[0]
    done = 0
    for axis in range(4):
        out[axis] = planner.physical[axis]
    if planner.running:
        block = ring[planner.tail]
        done, _, _ = walk(block, max(int((now - planner.run_start) * TIMER.ticks_per_s), 0))
        for axis in range(4):
            out[axis] += axis_steps(block.steps[axis], block.events, done)
    return done


@jit
def stop_now(planner_of: Records, ring: Records, log: Records, now: float) -> None:
    """Drop all blocks at ``now``, s; the running one ends at the steps that it has done."""
    run_until(planner_of, ring, log, now)
    planner = planner_of[0]
    before = np.empty(4, np.int64)
    done = count_steps(planner_of, ring, now, before)
    if planner.running:
        if done > 0:
            _write_log(planner, ring[planner.tail], log, done, now)
        planner.run_end = now
    planner.running = False
    planner.count = 0
    planner.prev_speed = 0
    for axis in range(4):
        planner.position[axis] = planner.physical[axis] - planner.shift[axis]


@jit
def set_axis(planner_of: Records, axis: int, target_mm: float) -> None:
    """Call the end of the last block ``target_mm`` on one axis; no motor moves."""
    planner = planner_of[0]
    steps = to_steps(target_mm, planner.steps_per_mm[axis])
    planner.shift[axis] += planner.position[axis] - steps
    planner.position[axis] = steps


@jit
def take_head(planner_of: Records, number: int, e_mm: float) -> None:
    """Have E move another head's plunger, and call where that stands ``e_mm``; motors must stand.

    Steps per mm and speed become that head's (Marlin's DISTINCT_E_FACTORS).
    """
    planner = planner_of[0]
    planner.plungers[planner.tool] = planner.physical[3]
    planner.tool = number
    planner.physical[3] = planner.plungers[number]
    planner.steps_per_mm[3] = planner.e_steps_per_mm[number]
    planner.mm_per_step[3] = np.float32(1) / planner.e_steps_per_mm[number]
    planner.max_speed[3] = planner.e_max_speed[number]
    planner.position[3] = to_steps(e_mm, planner.steps_per_mm[3])
    planner.shift[3] = planner.physical[3] - planner.position[3]
