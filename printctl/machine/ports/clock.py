"""Clock passed to everything that waits: real, or virtual for tests."""

from __future__ import annotations

import time
from functools import partial
from typing import Protocol


class Clock(Protocol):
    """Seconds since some start, never going back."""

    def now(self) -> float:
        """Return the time in s."""
        ...

    def sleep(self, seconds: float) -> None:
        """Let ``seconds`` pass."""
        ...


class RealClock:
    """The machine's monotonic clock, which goes on while the machine sleeps.

    Linux has another for that (`time.monotonic` stands still there); the others have one.
    """

    def __init__(self) -> None:
        boot = getattr(time, "CLOCK_BOOTTIME", None)
        # bound once: every line reads it
        self.now = time.monotonic if boot is None else partial(time.clock_gettime, boot)

    def sleep(self, seconds: float) -> None:
        """Sleep for ``seconds``."""
        time.sleep(max(0.0, seconds))


class VirtualClock:
    """A clock that moves only when somebody waits."""

    def __init__(self, start: float = 0.0) -> None:
        self._now = start

    def now(self) -> float:
        """Return the virtual time in s."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Move on by ``seconds`` at once."""
        self._now += max(0.0, seconds)

    def move_to(self, time_s: float) -> None:
        """Move on to ``time_s`` if that lies ahead."""
        self._now = max(self._now, time_s)
