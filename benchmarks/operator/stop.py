"""The operator's page during a print.

How long a touch of the red button takes to be a byte on the wire while a job of a million moves
streams in real time and five browsers look; and what five browsers cost the streaming. The wire is
tapped between the link process and the simulated printer.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import Row, row
from benchmarks.link.files import zigzag
from benchmarks.link.printers import PeerFailedError, Tap, profile, simulated
from benchmarks.operator.server import (
    WATCHED,
    WATCHING,
    browsers,
    page_server,
    show,
    touched_at,
    workspace,
)
from benchmarks.operator.streaming import streaming_rows
from printctl.machine.link import LinkState, start_print

REAL = {"clock": "wall"}
MOVES = 1_000_000
FOUND_S = 3.0
"""So long after a print's start the stop process has found it for certain."""


def rows(quick: bool) -> Iterator[Row]:
    """Yield stops from the page, and what browsers cost the streaming; quick has fewer tries."""
    tries, pairs = (2, 2) if quick else (20, 24)
    with (
        workspace() as place,
        page_server(place) as url,
        browsers(1 if quick else WATCHING) as pages,
    ):
        yield from stop_rows(tries, url, pages, place)
        yield from streaming_rows(pairs, url, pages, place)


def stop_rows(tries: int, url: str, pages: list[Any], folder: Path) -> Iterator[Row]:
    """Yield the time from the touch to the last byte of M112 on the wire."""
    job = zigzag(MOVES, 600).write(folder / "million.gcode")
    facts = profile(folder, "stop", resets_on_connect=False)
    took = []
    for k in range(tries):
        run = folder / "runs" / f"stop-{k}"
        run.mkdir(parents=True)
        (run / "part.gcode").hardlink_to(job)
        show(pages, f"{url}{WATCHED}")
        took.append(1e3 * _one_stop(pages[k % len(pages)], facts, run))
    middle, worst = float(np.median(took)), max(took)
    name = f"stop, {MOVES:,} moves streaming, {WATCHING} browsers: touch to byte on the wire"
    made = row(f"{name}, median", round(middle, 1), "ms", "<= 100", middle <= 100)
    yield made | REAL | {"tries": tries, "longest_ms": round(worst, 1)}


def _one_stop(page: Any, facts: str, folder: Path) -> float:
    with simulated(facts, "--speed", "1", "--tcp", "0") as port, Tap(_number(port)) as tap:
        with start_print(folder / "part.gcode", facts, tap.name, folder / "print") as client:
            time.sleep(FOUND_S)
            page.click("#pc-stop")
            outcome = client.wait(30)
        if outcome.state is not LinkState.KILLED:
            raise PeerFailedError(f"the stop ended as {outcome.state}: {outcome.message}")
        return tap.down_at(b"M112\n") - touched_at(page)


def _number(port: str) -> int:
    return int(port.rsplit(":", 1)[1])
