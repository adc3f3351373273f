"""The operator's page while it prints: ``make bench-operator``.

How long a touch of the red button takes to be a byte on the wire while a job of a million moves
streams in real time and five browsers look; and what five browsers cost the streaming. The wire is
tapped between the link process and the simulated printer. ``--quick`` takes fewer tries.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import psutil

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
WINDOW_S, SETTLE_S = 1.5, 0.5
MOST_PRINTS = 20
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
    pairs: int, url: str, pages: list[Any], workspace: Path, server: psutil.Process
) -> Iterator[Row]:
    """Lines per second to a peer that only answers, with the page at work and with it asleep.

    One print is streamed as fast as it goes; server and browsers are put to sleep (SIGSTOP) and
    woken in turns, so that both are measured within seconds of each other: the rate itself drifts
    by a factor of two within minutes here, bound as it is by the pseudo-terminal's wake-ups.
    """
    job = zigzag(MOVES).write(workspace / "speed.gcode")
    facts = profile(workspace, "speed", resets_on_connect=False)
    elsewhere = listeners(workspace / ".printctl" / "serve.json", WATCHING)
    here = _looking(pages, f"{url}{WATCHED}")
    for way, watched in (("elsewhere", elsewhere), ("on the same two cores", here)):
        with watched:
            place = workspace / "runs" / f"speed-{way.replace(' ', '-')}"
            found = _rates(pairs, job, facts, place, server)
        awake, asleep = zip(*found, strict=True)
        ratios = [a / b for a, b in found]
        slower = 100 * (1 - float(np.median(ratios)))
        name = f"streaming as fast as it goes, {WATCHING} browsers {way}, slower by"
        made = row(name, round(slower, 1), "%", "<= 5", slower <= 5)
        told = {"lines_s": round(float(np.median(awake))), "pairs": pairs}
        spread = [round(100 * (1 - r), 1) for r in np.percentile(ratios, (75, 25))]
        yield (
            made
            | REAL
            | told
            | {"without_lines_s": round(float(np.median(asleep)))}
            | {"quartiles_percent": spread}
        )


@contextmanager
def _looking(pages: list[Any], url: str) -> Iterator[None]:
    show(pages, url)
    yield
    for page in pages:
        page.goto("about:blank")


def _rates(
    pairs: int, job: Path, facts: str, folder: Path, server: psutil.Process
) -> list[tuple[float, float]]:
    """Rates with the page at work and with it asleep, in pairs of windows."""
    found: list[tuple[float, float]] = []
    for k in range(MOST_PRINTS):  # a quick machine prints the job more than once
        found += _of_one_print(
            pairs - len(found), job, facts, folder.with_name(f"{folder.name}-{k}"), server
        )
        if len(found) == pairs:
            return found
    raise PeerFailedError(f"{MOST_PRINTS} prints ended before {pairs} pairs of windows were over")


def _of_one_print(
    pairs: int, job: Path, facts: str, folder: Path, server: psutil.Process
) -> list[tuple[float, float]]:
    """As many pairs as one print lasts; ``folder`` is a run's, so that the page follows it."""
    folder.mkdir(parents=True)
    (folder / "part.gcode").hardlink_to(job)
    found: list[tuple[float, float]] = []
    with answerer(folder / "answered.json") as port:
        client = start_print(folder / "part.gcode", facts, port, folder / "print")
        time.sleep(FOUND_S)
        _until_checked(server)
        try:
            while len(found) < pairs:
                rates = {}
                for works in (True, False) if len(found) % 2 else (False, True):
                    _put(server, works)
                    time.sleep(SETTLE_S)
                    rates[works] = _rate(client)
                found.append((rates[True], rates[False]))
        except _PrintEndedError:
            pass
        finally:
            _put(server, True)
        client.kill()
        client.wait(60)
    return found


class _PrintEndedError(Exception):
    """The print is over; what was being measured counts for nothing."""


def _rate(client: PrintClient) -> float:
    """Lines per second over one window."""
    begin, done = time.monotonic(), client.status.lines_done
    time.sleep(WINDOW_S)
    status = client.status
    if status.ended and status.state is not LinkState.DONE:
        raise PeerFailedError(f"the print ended as {status.state}: {status.message}")
    if status.ended:
        raise _PrintEndedError
    return (status.lines_done - done) / (time.monotonic() - begin)


def _until_checked(server: psutil.Process) -> None:
    """A job that the page hasn't seen is run through the planner once, politely."""
    limit = time.monotonic() + 300.0
    while any("printctl.web.job.check" in one.cmdline() for one in server.children()):
        if time.monotonic() > limit:
            raise PeerFailedError("the job's check doesn't end")
        time.sleep(0.5)


def _server(workspace: Path) -> psutil.Process:
    said = json.loads((workspace / ".printctl" / "serve.json").read_text())
    return psutil.Process(said["pid"])


def _put(server: psutil.Process, works: bool) -> None:
    """Wake the page, server and browsers, or put it to sleep; not the red button's own process."""
    for one in [server, *_of_the_page()]:
        with contextlib.suppress(psutil.NoSuchProcess):
            if works:
                one.resume()
            else:
                one.suspend()


def _of_the_page() -> Iterator[psutil.Process]:
    for one in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.NoSuchProcess):  # it ended meanwhile
            if any(name in " ".join(one.cmdline()) for name in ("chrom", "operator_watch")):
                yield one


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
                server = _server(workspace)
                rows += streaming_rows(pairs, url, pages, workspace, server)
        except (PeerFailedError, LinkError, OSError) as error:
            left_out["the rest"] = f"{type(error).__name__}: {error}"
    found: Row = {"machine": machine() | {"load_before_and_after": [load, os.getloadavg()[0]]}}
    found |= {"commit": measured, "rows": rows, "not_measured": left_out}
    print(json.dumps(found, indent=1, ensure_ascii=False))


if __name__ == "__main__":
    main()
