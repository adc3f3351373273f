"""Marlin's kill: 0.6 s delay for its message, motors running on.

The wait is counted in the main thread's own time, and the step interrupts are still on: what the
planner holds is made meanwhile, and each step event makes the wait longer. Measured on
bugfix-2.1.x of 2024-10-11 on an ATmega2560 (simavr, 2026-11-22), from M112's last byte to the last
step: 0.638 s at 566 step events/s, 0.715 s at 2825, 0.843 s at 5634, 1.27 s at 10,680; with and
without emergency parser alike. That is 0.613 s and 47.5 µs for each event. Then interrupts go off.
"""

from __future__ import annotations

from typing import Final

from sim.devices.board.machine import Machine

RUN_ON_S: Final = 0.613
"""From the firmware's last word to the halt, with no motor running."""
RUN_ON_EVENT_S: Final = 47.5e-6
"""More for each step event within it."""


class WaitForWords:
    """The time between a kill's words and the halt.

    Parameters
    ----------
    machine : Machine
    """

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._begin_s, self._before = machine.now, machine.motion.events(machine.now)

    def ends_s(self) -> float:
        """When the motors stop, s, by the events up to now; later ones put it off."""
        done = self._machine.motion.events(self._machine.now) - self._before
        return self._begin_s + RUN_ON_S + RUN_ON_EVENT_S * done
