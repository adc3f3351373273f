"""Measure CPU time of a call, and compare alternative implementations in a row."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from benchmarks.machine import row


def cpu_ms(work: Callable[[], Any], rounds: int = 5) -> float:
    """Least processor time of all threads over some calls, ms; one call before isn't counted."""
    work()
    times = []
    for _ in range(rounds):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return 1e3 * min(times)


def against(
    measure: str, unit: str, ours: tuple[float, float], **others: tuple[float, float]
) -> dict[str, Any]:
    """Row of an error and a processor time (ms) by our way, and by others by name."""
    found = row(measure, ours[0], unit)
    return found | {
        "cpu_ms": round(ours[1], 3),
        "peers": {
            name: {"value": value, "cpu_ms": round(ms, 3)} for name, (value, ms) in others.items()
        },
    }
