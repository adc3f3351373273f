"""The live view of a job of a million moves: ``python -m benchmarks.operator_view``.

The page is served from a process of its own and opened in a headless Chromium without a graphics
card: WebGL is SwiftShader's and the page is put together by the processor, as Chromium does by
itself where there is none. First pictures are those of `printctl serve`'s page Job, from the
navigation in an open browser until the drawing of all moves is done (a fence behind it), confirmed
by a photograph. A server makes the scene of the job that it will show first by itself; so there is
a row for a job that came when it had made ready what it does. Updates come over the page's
WebSocket as a print of 20 mm/s would send them; processor time is the browser's, all its processes,
less that of the same page left alone.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import shutil
import socket
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
import psutil
from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

from benchmarks.machine import commit, machine, row
from benchmarks.operator_server import page_server

Row = dict[str, Any]
MOVES: Final = 1_000_000
RATE_HZ: Final = 4.0
MOVES_A_SECOND: Final = 48
CHROMIUM: Final = "/usr/bin/chromium"
ARGUMENTS: Final = ("--no-sandbox", "--enable-unsafe-swiftshader")
READY_S: Final = 10.0
"""So long after its start a server has made ready what it will."""
OPEN_S: Final = 2.0
"""So long before the navigation the browser was opened: its own start isn't the page's."""
COLOURED, LEAST_SHARE = 60, 0.1
"""A pixel is of a line when its channels differ so much; such a share of the view must be."""


def write_job(path: Path, moves: int) -> None:
    """Wavy lines of 0.4 mm moves, 10,000 a layer of 40 by 40 mm."""
    k = np.arange(moves)
    layer, i = np.divmod(k, 10_000)
    line, t = np.divmod(i, 100)
    along = np.where(line % 2 == 0, t, 99 - t) / 99.0
    across = 20 + 0.4 * line + 0.15 * np.sin(24 * np.pi * along + line)
    along = 20 + 40 * along
    x, y = np.where(layer % 2 == 0, [along, across], [across, along])
    ends = np.column_stack([x, y, 0.2 + 0.2 * layer, 0.0024 * (k + 1)]).tolist()
    head = "G21\nG90\nM82\nG92 X20 Y20 Z0.2 E0\n"
    path.write_text(
        head + "".join(f"G1 X{x:.3f} Y{y:.3f} Z{z:.3f} E{e:.5f} F1200\n" for x, y, z, e in ends)
    )


@contextmanager
def served(folder: Path) -> Iterator[tuple[str, psutil.Process]]:
    """The page's address, and the process that serves it."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "benchmarks.operator_view", "--serve", str(folder), str(port)]
    server = subprocess.Popen(command)
    address = f"http://127.0.0.1:{port}"
    try:
        for _ in range(600):
            try:
                urllib.request.urlopen(f"{address}/live/static/scene.js").close()
                break
            except OSError:
                time.sleep(0.1)
        time.sleep(8.0)  # the process that makes scenes has loaded what it needs
        yield address, psutil.Process(server.pid)
    finally:
        server.terminate()
        server.wait(20)


def serve(folder: Path, port: int) -> None:
    """Run the page's server."""
    import uvicorn

    from printctl.web.live import JobSource
    from tests.printctl.web.live.page import application

    jobs = {"million": JobSource(folder / "million.gcode", folder / "cache")}
    uvicorn.run(application(jobs), port=port, log_level="error", ws="websockets-sansio")


def processor_s(process: psutil.Process, named: str = "") -> float:
    """Processor time of a process's children (and theirs) with this in their name, s."""
    total = 0.0
    for each in process.children(recursive=True):
        try:
            if named in each.name():
                total += sum(each.cpu_times()[:2])
        except psutil.Error:
            continue
    return total


def first_picture_s(browser: Browser, url: str) -> float:
    """From the navigation until all moves are drawn on the page Job, on the wall clock.

    Raises
    ------
    RuntimeError
        When the page says that they are, and a photograph of it shows no coloured lines.
    """
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    time.sleep(OPEN_S)
    begin = time.monotonic()
    page.goto(url, wait_until="commit")
    page.wait_for_selector("[data-drawn]", timeout=60_000)
    found = time.monotonic() - begin
    photo = Image.open(io.BytesIO(page.locator(".live-stage canvas").screenshot())).convert("RGB")
    seen = np.asarray(photo).astype(int)
    if (np.ptp(seen, axis=2) > COLOURED).mean() < LEAST_SHARE:
        raise RuntimeError("the page says that the job is drawn, and the picture is empty")
    page.close()
    return found


def picture_rows(folder: Path, tries: int) -> Iterator[Row]:
    """First pictures on `printctl serve`'s own page, each in a browser that has seen nothing."""
    found: dict[str, list[float]] = {}
    for k in range(tries):
        for kind, took in (*visits(folder, "found at its start"), *visits(folder, "come later")):
            found.setdefault(kind, []).append(took)
            load = os.getloadavg()[0]
            print(f"{k + 1}, {kind}: {took:.2f} s, load {load:.1f}", file=sys.stderr, flush=True)
    for kind, times in found.items():
        value = round(statistics.median(times), 2)
        made = row(f"first picture of {MOVES} moves, {kind}", value, "s", "<= 3", value <= 3.0)
        yield made | {"all_s": [round(one, 2) for one in times]}


def visits(folder: Path, which: str) -> Iterator[tuple[str, float]]:
    """Visits of one server, whose only job was there before it or came when it was ready."""
    workspace = folder / "workspace"
    shutil.rmtree(workspace, ignore_errors=True)
    (workspace / "jobs").mkdir(parents=True)
    job = workspace / "jobs" / "million.gcode"
    if which == "found at its start":
        job.hardlink_to(folder / "million.gcode")
    with page_server(workspace) as url:
        time.sleep(READY_S)
        way = f"{url.rstrip('/')}/job?job=file~million.gcode"
        if which == "found at its start":
            yield "first visit of a server that found the job at its start", visit_s(way)
            shutil.rmtree(workspace / ".printctl" / "scenes")
            yield "cold, scene still to be made", visit_s(way)
            yield "scene kept", visit_s(way)
        else:
            job.hardlink_to(folder / "million.gcode")
            yield "first visit of a server that has made no scene yet", visit_s(way)


def visit_s(way: str) -> float:
    """As `first_picture_s`, in a browser of its own."""
    with sync_playwright() as started, launched(started) as browser:
        return first_picture_s(browser, way)


@contextmanager
def launched(started: Any) -> Iterator[Browser]:
    """A browser."""
    browser = started.chromium.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
    try:
        yield browser
    finally:
        browser.close()


def update_rows(address: str, server: psutil.Process, seconds: float) -> Iterator[Row]:
    """What updates cost, as a share of one core."""
    with sync_playwright() as started, launched(started) as browser:
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(f"{address}/job/million?source=/events")
        page.wait_for_selector("[data-drawn]", timeout=60_000)
        me = psutil.Process()
        send(page, address, 300_000, 0.0)
        time.sleep(6.0)
        shares = {}
        for kind, rate in (("idle", 0.0), ("live", RATE_HZ)):
            before, own = processor_s(me, "chrom"), sum(server.cpu_times()[:2])
            begin = time.monotonic()
            send_for(page, address, seconds, rate)
            took = time.monotonic() - begin
            shares[kind] = (processor_s(me, "chrom") - before) / took
            shares[f"server, {kind}"] = (sum(server.cpu_times()[:2]) - own) / took
    share = round(100 * (shares["live"] - shares["idle"]), 2)
    yield row(f"live updates at {RATE_HZ:g} Hz, browser", share, "% of a core", "<= 5", share <= 5)
    share = round(100 * (shares["server, live"] - shares["server, idle"]), 2)
    yield row(f"live updates at {RATE_HZ:g} Hz, server", share, "% of a core")


def send_for(page: Page, address: str, seconds: float, rate: float) -> None:
    """Send events at a rate for a time; none at 0."""
    end, done = time.monotonic() + seconds, 300_000.0
    while time.monotonic() < end:
        time.sleep(1.0 / rate if rate else seconds)
        if rate:
            done += MOVES_A_SECOND / rate
            send(page, address, int(done), done)


def send(page: Page, address: str, commands: int, place: float) -> None:
    """One event of the print to all who listen."""
    at = [20 + (0.4 * place) % 40, 40.0, 6.2]
    said = {"event": "print", "lines_done": commands + 16, "lines_executed": commands}
    data = json.dumps(said | {"position": at}).encode()
    asked = urllib.request.Request(
        f"{address}/tell", data, {"Content-Type": "application/json"}, method="POST"
    )
    urllib.request.urlopen(asked).close()


def main() -> None:
    """Measure and print the benchmark's one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--serve", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--quick", action="store_true", help="one try each instead of five")
    asked = parser.parse_args()
    if asked.serve:
        serve(Path(asked.serve[0]), int(asked.serve[1]))
        return
    measured, load = commit(), os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_job(folder / "million.gcode", MOVES)
        rows = list(picture_rows(folder, 1 if asked.quick else 5))
        with served(folder) as (address, server):
            rows += update_rows(address, server, 20.0)
    about = machine() | {"load_before_and_after": [load, os.getloadavg()[0]]}
    about["browser"] = f"Chromium, headless, {' '.join(ARGUMENTS)}: no graphics card"
    print(json.dumps({"machine": about, "commit": measured, "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
