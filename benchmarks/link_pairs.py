"""Two lines in flight against one: speed gain on a UART, and effect of noise."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers.link_order import since_renumbering
from benchmarks.link_files import PrintFile, hatching
from benchmarks.link_runs import DONE, new_printer, run
from benchmarks.link_wire import BreakingTroubles
from benchmarks.machine import row
from firmware_profiles.families.link_protocol import Timing
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.pairing import Pairing

Row = dict[str, Any]
LATENCIES_S = (0.0, 0.004, 0.016)
"""None; a quick adapter's; an adapter's that holds short replies for 16 ms, FTDI's default."""


def reckless_pairs() -> MarlinProtocol:
    """Two in flight again right after each doubt: the most that noise can be made of."""
    return MarlinProtocol(Timing(calm_lines=0), Pairing(128))


def gain_rows(lines: int, folder: Path) -> Iterator[Row]:
    """Short moves (0.25 mm at 50 mm/s, 200 a second) at 115,200 Bd, by the way back of a reply."""
    file = hatching(lines, 3000)
    for latency_s in LATENCIES_S:
        one = _rate(file, folder, latency_s, MarlinProtocol)
        two = _rate(file, folder, latency_s, lambda: MarlinProtocol(None, Pairing(128)))
        measure = f"115,200 Bd, replies {1e3 * latency_s:g} ms late: two lines in flight over one"
        made = row(measure, round(two / one, 3), "times")
        yield made | {"clock": "virtual", "lines_s": {"one": round(one), "two": round(two)}}


def _rate(
    file: PrintFile, folder: Path, latency_s: float, protocol: Callable[[], MarlinProtocol]
) -> float:
    """Lines a second, counted where the printer takes them."""
    troubles = BreakingTroubles(latency_s=latency_s)
    found = run(file, folder, 0, troubles, ledger=new_printer(), protocol=protocol)
    if found.status.state is not DONE or found.faults or found.unreached:
        raise ValueError(f"the print ended as {found.status}")
    ours, taken = set(file.lines), since_renumbering(found.ledger.taken)
    times = np.array([one.time_s for one in taken if one.meant in ours])
    return float((len(times) - 1) / (times[-1] - times[0]))
