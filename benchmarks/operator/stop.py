"""The operator's page during a print: stop, and what pages cost the streaming.

How long a touch of the red button takes to be a byte on the wire while a job of a million moves
streams in real time and fifty browsers look: five here, one of them at the print's live view, and
45 at other computers, clients that receive all events and draw nothing. The wire is tapped between
the link process and the simulated printer.
"""

from __future__ import annotations

import asyncio
import json
import multiprocessing
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import aiohttp
import numpy as np
import psutil

from benchmarks.common import Row, limited
from benchmarks.link.files import zigzag
from benchmarks.link.printers import (
    PeerFailedError,
    Tap,
    answerer,
    profile,
    read_record,
    simulated,
)
from benchmarks.operator.server import browsers, page_server, touched_at, workspace
from printctl.machine.process.clients.starting import start_print
from printctl.machine.process.orders import Order
from printctl.machine.records.states import LinkState

WALL = {"clock": "wall"}
MOVES, WATCHING, ELSEWHERE = 1_000_000, 5, 45
FOUND_S = 3.0
"""So long after a print's start server and stop process have found it for certain."""
WINDOW_S, SETTLE_S = 1.5, 0.5


def stop_rows(quick: bool) -> Iterator[Row]:
    """Yield the time from the touch to the last byte of the halt's first line on the wire."""
    watching, tries = (1, 2) if quick else (WATCHING, 20)
    with (
        workspace() as place,
        page_server(place) as server,
        browsers(watching) as pages,
        _listening(server, ELSEWHERE),
    ):
        job = zigzag(MOVES, 600).write(place / "million.gcode")
        facts, took = profile(place, "stop", resets_on_connect=False), []
        for k in range(tries):
            run = place / "runs" / f"stop-{k}"
            run.mkdir(parents=True)
            (run / "part.gcode").hardlink_to(job)
            for page in pages:
                at = f"/job?job=run~stop-{k}" if page is pages[0] else "/printer"
                page.goto(f"{server['url']}{at}")
                page.wait_for_selector("#pc-take:visible")
            took.append(1e3 * _one_stop(pages[k % len(pages)], facts, run))
    beside = f"{MOVES:,} moves streaming, a live view, {watching + ELSEWHERE} browsers"
    more = WALL | {"tries": tries, "longest_ms": round(max(took), 1)}
    yield (
        limited(
            f"stop, {beside}: touch to halt on the wire, median",
            round(float(np.median(took)), 1),
            "ms",
            100,
        )
        | more
    )


def _one_stop(page: Any, facts: str, folder: Path) -> float:
    with (
        simulated(facts, "--speed", "1", "--tcp", "0") as port,
        Tap(int(port.rsplit(":", 1)[1])) as tap,
    ):
        with start_print(Order(folder / "part.gcode", facts, tap.name, folder / "print")) as client:
            time.sleep(FOUND_S)
            page.click("#pc-stop")
            outcome = client.wait(30)
        if outcome.state is not LinkState.KILLED:
            raise PeerFailedError(f"the stop ended as {outcome.state}: {outcome.message}")
        # A board with an emergency parser gets M410 first, which ends its motion.
        return min(tap.down_at(b"M410\n"), tap.down_at(b"M112\n")) - touched_at(page)


def slowing_rows(quick: bool) -> Iterator[Row]:
    """Yield lines per second to a peer that only answers, the page awake and asleep.

    Server and clients are put to sleep (SIGSTOP) and woken in turns, so that both are measured
    within seconds of each other: the rate itself drifts by a factor of two within minutes.
    """
    with workspace() as place, page_server(place) as server:
        folder = place / "runs" / "speed"
        folder.mkdir(parents=True)
        job = zigzag(MOVES).write(folder / "part.gcode")
        facts = profile(place, "speed", resets_on_connect=False)
        with (
            _listening(server, WATCHING) as clients,
            answerer(folder / "answered.json") as port,
        ):
            pages = [psutil.Process(server["pid"]), psutil.Process(clients)]
            client = start_print(Order(job, facts, port, folder / "print"))
            time.sleep(FOUND_S)
            _wait_for_check(pages[0])
            _refuse_unfollowed(server)
            windows: list[dict[bool, tuple[float, float]]] = []
            while len(windows) < (2 if quick else 10) and not client.status.ended:
                order = (True, False) if len(windows) % 2 else (False, True)
                windows.append({awake: _window(pages, awake) for awake in order})
            for one in pages:
                one.resume()
            client.kill()
            client.wait(60)
        taken = np.array([when for when, _ in read_record(folder / "answered.json")])
    whole = [one for one in windows if max(end for _, end in one.values()) < taken[-1]]
    rates = np.array([[_rate(taken, one[awake]) for awake in (True, False)] for one in whole])
    if not len(rates):
        raise PeerFailedError("the print ended before the first pair of windows was over")
    slower = 100 * (1 - float(np.median(rates[:, 0] / rates[:, 1])))
    name = f"streaming as fast as it goes, {WATCHING} pages elsewhere, slower by"
    awake, asleep = np.median(rates, axis=0).round().tolist()
    more = {"lines_s": awake, "without_lines_s": asleep, "pairs": len(rates)}
    yield limited(name, round(slower, 1), "%", 5) | WALL | more


@contextmanager
def _listening(server: dict[str, Any], count: int) -> Iterator[int]:
    """Run so many pages of other computers, in a process of their own; give its number."""
    spawn = multiprocessing.get_context("spawn")
    how = server["url"], server["token"], count
    clients = spawn.Process(target=_listen, args=how, daemon=True)
    clients.start()
    try:
        yield clients.pid or 0
    finally:
        clients.terminate()


def _listen(url: str, token: str, count: int) -> None:
    """Receive all events, as often as pages look."""

    async def one(session: aiohttp.ClientSession) -> None:
        async with session.ws_connect(f"{url.rstrip('/')}/api/v1/events") as socket:
            async for _ in socket:
                pass

    async def every() -> None:
        async with aiohttp.ClientSession(headers={"Authorization": f"Bearer {token}"}) as session:
            await asyncio.gather(*(one(session) for _ in range(count)))

    asyncio.run(every())


def _window(pages: list[psutil.Process], awake: bool) -> tuple[float, float]:
    """Return begin and end of a while with the page awake or asleep, on `time.monotonic`."""
    for one in pages:
        one.resume() if awake else one.suspend()
    time.sleep(SETTLE_S)
    begin = time.monotonic()
    time.sleep(WINDOW_S)
    return begin, time.monotonic()


def _rate(taken: np.ndarray, window: tuple[float, float]) -> float:
    """Return the lines per second that the peer took in a window, by its own record."""
    begin, end = np.searchsorted(taken, window)
    return float(end - begin) / (window[1] - window[0])


def _wait_for_check(server: psutil.Process) -> None:
    """Wait while a job that the page hasn't seen is run through the planner."""
    limit = time.monotonic() + 300.0
    while any("printctl.web.job.check" in one.cmdline() for one in server.children()):
        if time.monotonic() > limit:
            raise PeerFailedError("the job's check doesn't end")
        time.sleep(0.5)


def _refuse_unfollowed(server: dict[str, Any]) -> None:
    """Raise unless the page follows the print: else it would cost nothing."""
    counts = []
    for _ in range(2):
        request = urllib.request.Request(
            f"{server['url'].rstrip('/')}/api/v1/prints/run~speed",
            headers={"Authorization": f"Bearer {server['token']}"},
        )
        with urllib.request.urlopen(request, timeout=30) as answer:
            counts.append(int(json.load(answer)["lines_done"]))
        time.sleep(1.0)
    if counts[0] >= counts[1]:
        raise PeerFailedError(f"the page doesn't follow the print: {counts} lines")
