"""Slow oracle of the stepper: one pulse at a time, in plain Python."""

from sim.gcode.motion.stepper import pulses_per_interrupt, timer_interval


def pulse_times(block):
    """Ticks from a block's start to each of its pulses."""
    slope = int(int(block["acceleration_rate"]) * (2**24 / 2_000_000))
    initial, nominal = int(block["initial_rate"]), int(block["nominal_rate"])
    final, events = int(block["final_rate"]), int(block["events"])
    up, down = int(block["accelerate_before"]), int(block["decelerate_start"])
    pulses = pulses_per_interrupt(initial)
    interval = timer_interval(initial // pulses)
    rising = falling = interval // 2
    peak, cruising = initial, False
    ticks, times = 0, []
    while True:
        ticks += interval + 1
        times += [ticks] * pulses
        done = len(times)
        if done >= events:
            return times[:events]
        if done < up:
            rate = peak = min((rising * slope >> 24) + initial, nominal)
        elif done >= down:
            rate = max(peak - (falling * slope >> 24), final)
        else:
            rate = peak = nominal
        pulses = pulses_per_interrupt(rate)
        interval = timer_interval(rate // pulses)
        if done < up:
            rising += interval
            falling = 0
        elif done >= down:
            falling += interval
        elif not cruising:
            cruising = True
            falling = interval // 2
