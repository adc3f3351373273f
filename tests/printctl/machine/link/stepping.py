"""Steps without a shell, and an exchange that follows a clock, for parts that are tested alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

from printctl.machine.control.board.steps import Steps
from printctl.machine.ports.clock import VirtualClock

T = TypeVar("T")


def ended(steps: Steps[T]) -> T:
    """Return what steps return that wait for nothing."""
    try:
        next(steps)
    except StopIteration as end:
        result: T = end.value
        return result
    raise AssertionError("it waits")


@dataclass
class ExchangeOf:
    """An exchange whose last event was just now."""

    clock: VirtualClock

    @property
    def now_s(self) -> float:
        return self.clock.now()
