"""Measure run time and memory of a pipeline stage."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

_STATUS = Path("/proc/self/status")
_CLEAR = Path("/proc/self/clear_refs")


def _reset_peak() -> None:
    """Linux only: writing 5 sets the peak of resident memory back to what is resident now."""
    if _CLEAR.exists():
        _CLEAR.write_text("5")


def peak_mb() -> float:
    """Peak resident memory of this process in MB (10⁶ bytes); since the last reset on Linux."""
    if _STATUS.exists():
        for line in _STATUS.read_text().splitlines():
            if line.startswith("VmHWM"):
                return int(line.split()[1]) * 1024 / 1e6
    if sys.platform == "win32":
        return 0.0
    import resource  # Unix only, hence not at the top.

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6


@dataclass
class RunMeter:
    """Context manager: wall seconds and peak MB of what runs inside."""

    seconds: float = 0.0
    peak_mb: float = 0.0
    _begin: float = 0.0

    def __enter__(self) -> RunMeter:
        _reset_peak()
        self._begin = time.perf_counter()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.seconds = time.perf_counter() - self._begin
        self.peak_mb = peak_mb()
