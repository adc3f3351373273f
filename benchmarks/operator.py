"""Web interface during a print: ``make bench-operator``.

How long a touch of the red button takes to be a byte on the wire while a job of a million moves
streams in real time and five browsers look; and what five browsers cost the streaming. The wire is
tapped between the link process and the simulated printer. ``--quick`` takes fewer tries.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.link_files import zigzag
from benchmarks.link_printers import PeerFailedError, profile, simulated
from benchmarks.link_tap import Tap
from benchmarks.machine import commit, machine, row
from benchmarks.operator_server import WATCHED, WATCHING, browsers, page_server, show, touched_at
from benchmarks.operator_streaming import streaming_rows
from printctl.machine.link import LinkError, LinkState, start_print

Row = dict[str, Any]
REAL = {"clock": "wall"}
MOVES = 1_000_000
FOUND_S = 3.0
"""So long after a print's start the stop process has found it for certain."""


def stop_rows(tries: int, url: str, pages: list[Any], workspace: Path) -> Iterator[Row]:
    """From the touch to the last byte of M112 on the wire."""
    job = zigzag(MOVES, 600).write(workspace / "million.gcode")
    facts = profile(workspace, "stop", resets_on_connect=False)
    took = []
    for k in range(tries):
        folder = workspace / "runs" / f"stop-{k}"
        folder.mkdir(parents=True)
        (folder / "part.gcode").hardlink_to(job)
        show(pages, f"{url}{WATCHED}")
        took.append(1e3 * _one_stop(pages[k % len(pages)], facts, folder))
        print(f"stop {k + 1} of {tries}: {took[-1]:.1f} ms", file=sys.stderr, flush=True)
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


def main() -> None:
    """Measure and print the benchmark's one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer tries")
    asked = parser.parse_args()
    tries, pairs = (3, 4) if asked.quick else (20, 24)
    load, measured = os.getloadavg()[0], commit()
    rows: list[Row] = []
    left_out: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as folder:
        os.environ["PRINTCTL_DATA"] = folder  # these prints aren't the user's
        workspace = Path(folder) / "workspace"
        workspace.mkdir()
        try:
            with page_server(workspace) as url, browsers(WATCHING) as pages:
                rows += stop_rows(tries, url, pages, workspace)
                rows += streaming_rows(pairs, url, pages, workspace)
        except (PeerFailedError, LinkError, OSError) as error:
            left_out["the rest"] = f"{type(error).__name__}: {error}"
    found: Row = {"machine": machine() | {"load_before_and_after": [load, os.getloadavg()[0]]}}
    found |= {"commit": measured, "rows": rows, "not_measured": left_out}
    print(json.dumps(found, indent=1, ensure_ascii=False))


if __name__ == "__main__":
    main()
