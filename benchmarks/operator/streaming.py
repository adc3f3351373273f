"""Slow-down of full-speed streaming by an open web page."""

from __future__ import annotations

import contextlib
import json
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from benchmarks.common import Row, row
from benchmarks.link.files import zigzag
from benchmarks.link.printers import PeerFailedError, answerer, profile, read_record
from benchmarks.operator.server import WATCHED, WATCHING, show
from benchmarks.operator.watch import listeners
from printctl.machine.link import start_print

MOVES = 1_000_000
WINDOW_S, SETTLE_S = 1.5, 0.5
MOST_PRINTS = 20
FOUND_S = 3.0
"""So long after a print's start the server has found it for certain."""


def streaming_rows(pairs: int, url: str, pages: list[Any], workspace: Path) -> Iterator[Row]:
    """Lines per second to a peer that only answers, with the page at work and with it asleep.

    One print is streamed as fast as it goes; server and browsers are put to sleep (SIGSTOP) and
    woken in turns, so that both are measured within seconds of each other: the rate itself drifts
    by a factor of two within minutes here, bound as it is by the pseudo-terminal's wake-ups.
    """
    server = psutil.Process(_server_of(workspace)["pid"])
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
            | {"clock": "wall"}
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
    windows: list[dict[bool, tuple[float, float]]] = []
    with answerer(folder / "answered.json") as port:
        client = start_print(folder / "part.gcode", facts, port, folder / "print")
        time.sleep(FOUND_S)
        _until_checked(server)
        _refuse_unfollowed(folder)
        try:
            while len(windows) < pairs and not client.status.ended:
                order = (True, False) if len(windows) % 2 else (False, True)
                windows.append({works: _window(server, works) for works in order})
        finally:
            _put(server, True)
        client.kill()
        client.wait(60)
    taken = np.array([when for when, _ in read_record(folder / "answered.json")])
    whole = [one for one in windows if max(end for _, end in one.values()) < taken[-1]]
    return [(_rate(taken, one[True]), _rate(taken, one[False])) for one in whole]


def _window(server: psutil.Process, works: bool) -> tuple[float, float]:
    """Begin and end of a while with the page at work or asleep, on `time.monotonic`."""
    _put(server, works)
    time.sleep(SETTLE_S)
    begin = time.monotonic()
    time.sleep(WINDOW_S)
    return begin, time.monotonic()


def _rate(taken: np.ndarray, window: tuple[float, float]) -> float:
    """Lines per second that the peer took in a window, by its own record."""
    begin, end = np.searchsorted(taken, window)
    return float(end - begin) / (window[1] - window[0])


def _refuse_unfollowed(folder: Path) -> None:
    """A page that doesn't follow the print would cost nothing."""
    counts = []
    for _ in range(2):
        counts.append(_said_by_the_page(folder))
        time.sleep(1.0)
    if counts[0] >= counts[1]:
        raise PeerFailedError(f"the page doesn't follow the print in {folder}: {counts} lines")


def _said_by_the_page(folder: Path) -> int:
    """Lines done, as the page's API tells it."""
    said = _server_of(folder.parents[1])
    way = f"{said['url'].rstrip('/')}/api/v1/prints/run~{folder.name}"
    asked = urllib.request.Request(way, headers={"Authorization": f"Bearer {said['token']}"})
    with urllib.request.urlopen(asked, timeout=30) as answer:
        return int(json.load(answer)["lines_done"])


def _until_checked(server: psutil.Process) -> None:
    """A job that the page hasn't seen is run through the planner once, politely."""
    limit = time.monotonic() + 300.0
    while any("printctl.web.job.check" in one.cmdline() for one in server.children()):
        if time.monotonic() > limit:
            raise PeerFailedError("the job's check doesn't end")
        time.sleep(0.5)


def _server_of(workspace: Path) -> dict[str, Any]:
    """Address, process and token of the page's server."""
    said: dict[str, Any] = json.loads((workspace / ".printctl" / "serve.json").read_text())
    return said


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
            if any(name in " ".join(one.cmdline()) for name in ("chrom", "operator.watch")):
                yield one
