"""Benchmark rows: how long motors keep stepping after an operator's kill or stop."""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks.common import Row, row
from benchmarks.firmware.avr_board import AvrBoard
from benchmarks.firmware.gcode_files import MARLIN_STEPS, raster
from benchmarks.firmware.product import attend
from benchmarks.firmware.serial_host import SerialHost
from benchmarks.firmware.stop_moments import moment_rows

GOAL_MS = 1000.0
MOVE_MS = 1000.0
"""Of the longest move in the file: 20 mm at 20 mm/s."""


def stop_ms(image: Path, folder: Path, turn: int, letter: str, axes: str = "XYZE") -> float | None:
    """Return the time from the answered question to the last step edge, ms; None: never printed.

    Of a stop only ``axes`` XY count: the way out moves the plunger and the lift.
    """
    folder.mkdir(parents=True, exist_ok=True)
    job = raster(100, width_mm=20.0).write(folder / f"stop-{letter}-{turn}.gcode")
    with AvrBoard(image, folder / f"board-{letter}-{turn}") as board:
        attended, until = attend(job, board.port), time.monotonic() + 60
        while board.positions()["E"] < (0.5 + 0.1 * turn) * MARLIN_STEPS["E"]:
            attended.read(0.02)
            if time.monotonic() > until:
                attended.process.kill()
                return None
        asked = attended.choose(letter)
        code = attended.wait(40)
        time.sleep(1.0)
        steps = [board.log().steps(axis) for axis in axes]
        last = max(float(found["ns"].max()) / 1e9 for found in steps if len(found))
    took = 1000 * (last - asked)
    print(f"{image.name}, {letter}: {took:.1f} ms, exit {code}", file=sys.stderr, flush=True)
    return took


def bare_stop_ms(image: Path, folder: Path) -> float:
    """Return the firmware's own time from the bytes of M112 to the last step edge, ms."""
    with AvrBoard(image, folder) as board:
        host = SerialHost(board.port)
        time.sleep(2.5)
        for line in ("G91", "M302 P1", *["G1 X5 F1800", "G1 X-5"] * 8):
            host.ask(line)
        asked = time.monotonic()
        host.write("M112")
        time.sleep(4.0)
        host.close()
        return 1000 * (board.log().last_edge_s() - asked)


def stop_rows(image: Path, folder: Path, tries: int, build: str) -> Iterator[Row]:
    """Measure kills by Ctrl-C and k, stops by Ctrl-C and s."""
    found = [stop_ms(image, folder, turn, "k") for turn in range(tries)]
    known = [took for took in found if took is not None]
    name = f"real Marlin, {build}, {tries} kills (Ctrl-C, k): answer to last step edge, "
    if not known:
        yield row(name + "median", float("nan"), "ms", f"{GOAL_MS:g}", False)
        return
    yield row(name + "median", round(statistics.median(known), 1), "ms")
    bare = round(bare_stop_ms(image, folder / "bare"), 1)
    yield row(f"real Marlin, {build}, M112 written by a plain host: to last step edge", bare, "ms")
    yield row(name + "longest", round(max(known), 1), "ms", f"{GOAL_MS:g}", max(known) <= GOAL_MS)
    stops = [stop_ms(image, folder, turn, "s", "XY") for turn in range(tries)]
    longest = max((took for took in stops if took is not None), default=float("nan"))
    name = f"real Marlin, {build}, {tries} controlled stops (Ctrl-C, s), moves of 1 s: "
    yield row(
        name + "answer to last step edge of X or Y, longest", round(longest, 1), "ms",
        f"{GOAL_MS + MOVE_MS:g}", longest <= GOAL_MS + MOVE_MS,
    )  # fmt: skip
    yield from moment_rows(image, folder / "moments", tries, build)
