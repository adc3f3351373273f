"""First pictures of a job of a million moves on the page Job of `printctl serve`.

In a headless Chromium without a graphics card: WebGL is SwiftShader's. From the navigation in an
open browser until the drawing of all moves is done (a fence behind it), confirmed by a photograph.
A server makes the scene of the job that it will show first by itself; so there is a row for a job
that came when it had made ready what it does.
"""

from __future__ import annotations

import io
import shutil
import statistics
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks.common import Row, limited
from benchmarks.operator.server import browsers, chromium_path, page_server, workspace

MOVES = 1_000_000
READY_S = 10.0
"""So long after its start a server has made ready what it will."""
OPEN_S = 2.0
"""So long before the navigation the browser was opened: its own start isn't the page's."""
COLOURED, LEAST_SHARE = 60, 0.1
"""A pixel is of a line when its channels differ so much; such a share of the view must be."""


def rows(quick: bool) -> Iterator[Row]:
    """Yield first pictures; quick has a tenth of the moves and one try."""
    chromium_path()
    moves = MOVES // 10 if quick else MOVES
    found: dict[str, list[float]] = {}
    with workspace() as place:
        write_job(place.parent / "million.gcode", moves)
        for _ in range(1 if quick else 5):
            for early in (True, False):
                for kind, took in visits(place.parent, early):
                    found.setdefault(kind, []).append(took)
    for kind, times in found.items():
        name = f"first picture of {moves:,} moves, {kind}"
        made = limited(name, round(statistics.median(times), 2), "s", 3.0)
        yield made | {"all_s": [round(one, 2) for one in times]}


def write_job(path: Path, moves: int) -> None:
    """Write wavy lines of 0.4 mm moves, 10,000 a layer of 40 by 40 mm."""
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


def first_picture_s(url: str) -> float:
    """Return the time from the navigation, in a browser of its own, until all moves are drawn.

    Raises
    ------
    RuntimeError
        When the page says that they are, and a photograph of it shows no coloured lines.
    """
    with browsers(1) as (page,):
        page.set_viewport_size({"width": 1280, "height": 800})
        time.sleep(OPEN_S)
        begin = time.monotonic()
        page.goto(url, wait_until="commit")
        page.wait_for_selector("[data-drawn]", timeout=60_000)
        took = time.monotonic() - begin
        photo = Image.open(io.BytesIO(page.locator(".live-stage canvas").screenshot()))
    if (
        np.ptp(np.asarray(photo.convert("RGB")).astype(int), axis=2) > COLOURED
    ).mean() < LEAST_SHARE:
        raise RuntimeError("the page says that the job is drawn, and the picture is empty")
    return took


def visits(folder: Path, early: bool) -> Iterator[tuple[str, float]]:
    """Yield visits of one server, whose only job was there before it, or came when it was ready."""
    place = folder / "served"
    shutil.rmtree(place, ignore_errors=True)
    (place / "jobs").mkdir(parents=True)
    job = place / "jobs" / "million.gcode"
    if early:
        job.hardlink_to(folder / "million.gcode")
    with page_server(place) as server:
        time.sleep(READY_S)
        url = f"{server['url'].rstrip('/')}/job?job=file~million.gcode"
        if early:
            yield "first visit of a server that found the job at its start", first_picture_s(url)
            shutil.rmtree(place / ".printctl" / "scenes")
            yield "cold, scene still to be made", first_picture_s(url)
            yield "scene kept", first_picture_s(url)
        else:
            job.hardlink_to(folder / "million.gcode")
            yield "first visit of a server that has made no scene yet", first_picture_s(url)
