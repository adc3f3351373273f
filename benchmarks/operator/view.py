"""Live view of a job of a million moves.

The page is `printctl serve`'s, opened in a headless Chromium without a graphics
card: WebGL is SwiftShader's and the page is put together by the processor, as Chromium does by
itself where there is none. First pictures are those of `printctl serve`'s page Job, from the
navigation in an open browser until the drawing of all moves is done (a fence behind it), confirmed
by a photograph. A server makes the scene of the job that it will show first by itself; so there is
a row for a job that came when it had made ready what it does. Updates are those of the same page
while a simulated printer prints the job in real time; processor time is the browser's, all its
processes, less that of the same browser with an empty page.
"""

from __future__ import annotations

import io
import shutil
import statistics
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image
from playwright.sync_api import Browser, sync_playwright

from benchmarks.common import Row, row
from benchmarks.operator.server import chromium_path, page_server, workspace

MOVES: Final = 1_000_000
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


def picture_rows(folder: Path, moves: int, tries: int) -> Iterator[Row]:
    """First pictures on `printctl serve`'s own page, each in a browser that has seen nothing."""
    found: dict[str, list[float]] = {}
    for _ in range(tries):
        for kind, took in (*visits(folder, "found at its start"), *visits(folder, "come later")):
            found.setdefault(kind, []).append(took)
    for kind, times in found.items():
        value = round(statistics.median(times), 2)
        made = row(f"first picture of {moves:,} moves, {kind}", value, "s", "<= 3", value <= 3.0)
        yield made | {"all_s": [round(one, 2) for one in times]}


def visits(folder: Path, which: str) -> Iterator[tuple[str, float]]:
    """Visits of one server, whose only job was there before it or came when it was ready."""
    place = folder / "served"
    shutil.rmtree(place, ignore_errors=True)
    (place / "jobs").mkdir(parents=True)
    job = place / "jobs" / "million.gcode"
    if which == "found at its start":
        job.hardlink_to(folder / "million.gcode")
    with page_server(place) as url:
        time.sleep(READY_S)
        way = f"{url.rstrip('/')}/job?job=file~million.gcode"
        if which == "found at its start":
            yield "first visit of a server that found the job at its start", visit_s(way)
            shutil.rmtree(place / ".printctl" / "scenes")
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
    browser = started.chromium.launch(executable_path=chromium_path(), args=list(ARGUMENTS))
    try:
        yield browser
    finally:
        browser.close()


def rows(quick: bool) -> Iterator[Row]:
    """Yield first pictures; quick has a tenth of the moves and one try."""
    chromium_path()
    moves = MOVES // 10 if quick else MOVES
    with workspace() as place:
        folder = place.parent
        write_job(folder / "million.gcode", moves)
        yield from picture_rows(folder, moves, 1 if quick else 5)
