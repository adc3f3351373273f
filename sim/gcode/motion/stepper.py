"""Step a motion block as Marlin's stepper interrupt does: step events done, timer ticks taken.

The interrupt of an 8-bit board runs on a 16-bit timer at 2 MHz. After each pulse it works out the
rate of the next one from the time spent accelerating so far and turns it into a timer interval by
a table of two parts, interpolated linearly (fine above 2048 events/s, coarse below). In the
timer's clear-on-compare mode a period is one tick longer than its compare value.
"""

from __future__ import annotations

from kernels import jit
from sim.gcode.motion.state import Record

TICKS_PER_S = 2_000_000
SLOWEST = 32
"""Least rate, events/s, at which the 16-bit timer doesn't overflow."""
LEAST_RATE = 32
"""Least rate of a trapezoid's ends, events/s."""
MAX_RATE = 10_000
"""Events/s above which one interrupt gives two pulses, then four and so on."""
PERIOD_EXTRA = 1
"""Ticks that the timer adds to each interval."""
NO_LIMIT = 1 << 62


@jit
def timer_interval(rate: int) -> int:
    """Ticks that the table of the 8-bit boards gives for ``rate`` events/s."""
    if rate <= SLOWEST:
        return TICKS_PER_S // SLOWEST
    above = rate - SLOWEST
    if above >= 2048:
        base = TICKS_PER_S // (SLOWEST + (above & ~255))
        gain = base - TICKS_PER_S // (SLOWEST + (above & ~255) + 256)
        return base - ((gain * (above & 255)) >> 8)
    base = TICKS_PER_S // (SLOWEST + (above & ~7))
    gain = base - TICKS_PER_S // (SLOWEST + (above & ~7) + 8)
    return base - ((gain * (above & 7)) >> 3)


@jit
def pulses_per_interrupt(rate: int) -> int:
    """Pulses of one interrupt at ``rate`` events/s: a power of two, at most 16."""
    pulses = 1
    while pulses < 16 and rate > MAX_RATE * pulses:
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
    limit = ticks_left if ticks_left >= 0 else NO_LIMIT
    # Rates in 24-bit fixed point per tick, as the interrupt multiplies them.
    slope = int(block.acceleration_rate * (16777216.0 / TICKS_PER_S))
    rate = block.initial_rate
    peak = rate
    pulses = pulses_per_interrupt(rate)
    interval = timer_interval(rate // pulses)
    accelerating = interval // 2
    decelerating = interval // 2
    first = interval + PERIOD_EXTRA
    ticks = 0
    events = 0
    cruise = 0
    cruise_pulses = 1
    while True:
        if ticks + interval + PERIOD_EXTRA > limit:
            return events, ticks, first
        ticks += interval + PERIOD_EXTRA
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
            skip = min(skip, (limit - ticks) // (interval + PERIOD_EXTRA))
            if skip > 0:
                ticks += skip * (interval + PERIOD_EXTRA)
                events += skip * pulses


@jit
def axis_steps(steps: int, events: int, done: int) -> int:
    """Steps of one axis after ``done`` of a block's ``events``: Bresenham from one half."""
    size = abs(steps)
    taken = (2 * size * done + events) // (2 * events)
    return taken if steps >= 0 else -taken
