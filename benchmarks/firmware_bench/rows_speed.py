"""Rows: lines a second on a real Marlin against what its wire carries."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from benchmarks.firmware_bench.avr_board import AvrBoard
from benchmarks.firmware_bench.gcode_files import HEAD, MotionFile, short_moves
from benchmarks.firmware_bench.product import print_file
from benchmarks.firmware_bench.rows_done import stand_still
from benchmarks.firmware_bench.serial_host import SerialHost
from benchmarks.machine import row

Row = dict[str, Any]


def numbered(line: str, number: int) -> str:
    """Return a line with number and checksum."""
    text, total = f"N{number} {line}", 0
    for byte in text.encode():
        total ^= byte
    return f"{text}*{total}"


def board_seconds(board: AvrBoard) -> float:
    """Return the time from the first to the last step edge, s of the board's own clock."""
    steps = board.log().steps()
    return (int(steps["cycle"].max()) - int(steps["cycle"].min())) / 16e6 if len(steps) else 0.0


def by_hand(image: Path, folder: Path, file: MotionFile, in_flight: int) -> tuple[float, float]:
    """Send the file with a fixed number of lines in flight; return lines/s and bytes a line."""
    with AvrBoard(image, folder) as board:
        host = SerialHost(board.port)
        time.sleep(2.5)
        for line in ["M110 N0", *HEAD]:
            host.ask(line)
        before, waiting = board.state()["bytes_in"], 0
        for number, line in enumerate(file.lines[len(HEAD) :], 1):
            host.write(numbered(line, number))
            waiting += 1
            while waiting >= in_flight:
                host.wait_for("ok", 20)
                waiting -= 1
        while waiting:
            host.wait_for("ok", 20)
            waiting -= 1
        taken = board.state()["bytes_in"] - before
        host.ask("M400", 30)
        host.close()
        count = len(file.lines) - len(HEAD)
        return count / board_seconds(board), taken / count


def by_product(image: Path, folder: Path, file: MotionFile, baud: int) -> tuple[float, str, float]:
    """Print the file; return lines/s, the state of its end and the time that slipped, s."""
    folder.mkdir(parents=True, exist_ok=True)
    job = file.write(folder / "speed.gcode")
    profile = write_profile(folder / "bench_printer.yaml", baud)
    with AvrBoard(image, folder / "board") as board:
        ended = print_file(job, board.port, str(profile))
        stand_still(board)
        count, slipped = len(file.lines) - len(HEAD), board.state()["slipped_s"]
        return count / max(board_seconds(board), 1e-9), ended.state, slipped


def write_profile(path: Path, baud: int, more: Iterable[str] = ()) -> Path:
    """Write a printer profile of the benchmark's own for the images here."""
    facts = [
        "name: benchmark's Marlin",
        "source: benchmarks/firmware_bench",
        "licence: facts, no licence needed",
        "firmware: marlin",
        f"baud: {baud}",
        "x_mm: {low: 0, high: 200}",
        "y_mm: {low: 0, high: 200}",
        "z_mm: {low: 0, high: 200}",
        "steps_per_mm: {x: 80, y: 80, z: 400, e: 500}",
        "max_speed_mm_s: {x: 300, y: 300, z: 5, e: 25}",
        "max_acceleration_mm_s2: {x: 3000, y: 3000, z: 100, e: 10000}",
        "acceleration_mm_s2: 3000",
        "junction_deviation_mm: 0.013",
        "plunger_travel_mm: 60",
        "safe_state_on: []",
        *more,
    ]
    path.write_text("\n".join(facts) + "\n")
    return path


def speed_rows(image: Path, folder: Path, baud: int, moves: int) -> Iterator[Row]:
    """Measure the product beside plain hosts with one, two and three lines in flight."""
    file = short_moves(moves)
    mine, state, slipped = by_product(image, folder / "product", file, baud)
    name = f"real Marlin, {baud} Bd, {moves} moves of 0.1 mm: "
    figures = [by_hand(image, folder / f"hand{n}", file, n) for n in (1, 2, 3)]
    wire = baud / 10 / figures[0][1]
    one, best = figures[0][0], max(found[0] for found in figures)
    yield row(name + "lines that the wire carries (with number and checksum)", round(wire), "1/s")
    for n, (rate, _) in enumerate(figures, 1):
        yield row(name + f"plain host, {n} in flight", round(rate, 1), "1/s")
    goal = "0.97 of the plain host's with one in flight"
    met = state == "done" and mine >= 0.97 * one
    yield row(name + f"printctl ({state}, slipped {slipped} s)", round(mine, 1), "1/s", goal, met)
    yield row(name + "printctl over the best plain host", round(mine / best, 3), "")
