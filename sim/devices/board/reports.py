"""Unsolicited reports of a simulated firmware (temperature, position), and its print timer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass
class Reports:
    """Interval and next time of each report, s."""

    temperature_s: float = 0.0
    temperature_at: float = np.inf
    position_s: float = 0.0
    position_at: float = np.inf
    keepalive_s: float = 2.0


@dataclass
class JobTimer:
    """A print timer."""

    started_at: float | None = None
    gathered_s: float = 0.0

    def start(self, now: float) -> None:
        """Start, afresh where it was stopped."""
        if self.started_at is None:
            self.started_at = now

    def stop(self, now: float) -> None:
        """Stop and keep what was gathered."""
        self.gathered_s = self.read(now)
        self.started_at = None

    def read(self, now: float) -> float:
        """Seconds gathered."""
        running = 0.0 if self.started_at is None else now - self.started_at
        return self.gathered_s + running
