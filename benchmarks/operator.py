"""The operator's page while it prints: ``make bench-operator``.

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
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.link_files import zigzag
from benchmarks.link_printers import PeerFailedError, answerer, profile, simulated
from benchmarks.link_tap import Tap
from benchmarks.machine import commit, machine, row
from benchmarks.operator_server import browsers, page_server, show, touched_at
from benchmarks.operator_watch import listeners
from printctl.link import LinkError, LinkState, PrintClient, start_print

Row = dict[str, Any]
REAL = {"clock": "wall"}
WATCHING = 5
WATCHED = "/printer"
MOVES = 1_000_000
FOUND_S = 3.0
"""So long after a print's start the stop door has found it for certain."""


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


def streaming_rows(
    pairs: int, lines: int, url: str, pages: list[Any], workspace: Path
) -> Iterator[Row]:
    """Lines per second to a peer that only answers, watched in two ways and not, in turns."""
    job = zigzag(lines).write(workspace / "speed.gcode")
    facts = profile(workspace, "speed", resets_on_connect=False)
    ways = {
        "alone": nullcontext,
        "browsers elsewhere": lambda: listeners(workspace / ".printctl" / "serve.json", WATCHING),
        "browsers on the same two cores": lambda: _looking(pages, url),
    }
    rates: dict[str, list[float]] = {way: [] for way in ways}
    for k in range(pairs):
        for way in sorted(ways, reverse=bool(k % 2)):
            with ways[way]():
                time.sleep(FOUND_S)
                place = workspace / "runs" / f"speed-{k}-{way.replace(' ', '-')}"
                rates[way].append(_rate(job, facts, place))
            print(f"{way}: {rates[way][-1]:.0f} lines/s", file=sys.stderr, flush=True)
    alone = float(np.median(rates["alone"]))
    for way in list(ways)[1:]:
        slower = 100 * (1 - float(np.median(rates[way])) / alone)
        name = f"streaming as fast as it goes, {WATCHING} {way}, slower by"
        made = row(name, round(slower, 1), "%", "<= 5", slower <= 5)
        told = {"alone_lines_s": [round(one) for one in rates["alone"]]}
        yield made | REAL | {"pairs": pairs} | told | {"lines_s": [round(o) for o in rates[way]]}


@contextmanager
def _looking(pages: list[Any], url: str) -> Iterator[None]:
    show(pages, f"{url}{WATCHED}")
    yield
    for page in pages:
        page.goto("about:blank")


def _rate(job: Path, facts: str, folder: Path) -> float:
    folder.mkdir(parents=True)
    (folder / "part.gcode").hardlink_to(job)
    with answerer(folder / "answered.json") as port:
        client: PrintClient = start_print(folder / "part.gcode", facts, port, folder / "print")
        begin, done = time.monotonic(), client.status.lines_done
        outcome = client.wait(600)
    if outcome.state is not LinkState.DONE:
        raise PeerFailedError(f"the print ended as {outcome.state}: {outcome.message}")
    return (outcome.lines_done - done) / (time.monotonic() - begin)


def main() -> None:
    """Measure and print the benchmark's one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer tries")
    asked = parser.parse_args()
    tries, pairs, lines = (3, 2, 50_000) if asked.quick else (20, 5, 200_000)
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
                rows += streaming_rows(pairs, lines, url, pages, workspace)
        except (PeerFailedError, LinkError, OSError) as error:
            left_out["the rest"] = f"{type(error).__name__}: {error}"
    found: Row = {"machine": machine() | {"load_before_and_after": [load, os.getloadavg()[0]]}}
    found |= {"commit": measured, "rows": rows, "not_measured": left_out}
    print(json.dumps(found, indent=1, ensure_ascii=False))


if __name__ == "__main__":
    main()
