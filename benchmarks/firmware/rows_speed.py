"""Benchmark rows: lines per second on a real Marlin against the serial line's capacity."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from benchmarks.common import Row, row
from benchmarks.firmware.avr_board import AvrBoard
from benchmarks.firmware.gcode_files import HEAD, MotionFile, short_moves
from benchmarks.firmware.product import print_file
from benchmarks.firmware.rows_done import stand_still
from benchmarks.firmware.serial_host import SerialHost

IN_FLIGHT = (1, 2, 3)


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


def by_hand(
    image: Path, folder: Path, file: MotionFile, in_flight: int, speed: float = 1.0
) -> tuple[float, float]:
    """Send the file with a fixed number of lines in flight; return lines/s and bytes a line."""
    with AvrBoard(image, folder, speed) as board:
        host = SerialHost(board.port)
        time.sleep(2.5 / speed)
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


def by_product(
    image: Path, folder: Path, file: MotionFile, baud: int, in_flight: int, speed: float = 1.0
) -> tuple[float, str, float]:
    """Print the file; return lines/s, the state of its end and the time that slipped, s."""
    folder.mkdir(parents=True, exist_ok=True)
    job = file.write(folder / "speed.gcode")
    profile = write_profile(folder / "bench_printer.yaml", baud, [f"lines_in_flight: {in_flight}"])
    with AvrBoard(image, folder / "board", speed) as board:
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


@dataclass(frozen=True)
class Round:
    """Lines/s of one round: plain hosts with so many lines in flight, the product with 1 and 2."""

    plain: tuple[float, ...]
    product: tuple[float, ...]
    states: tuple[str, ...]
    slipped_s: float

    @property
    def shares(self) -> list[float]:
        """Return the product's shares of the best plain host's lines/s."""
        return [rate / max(self.plain) for rate in self.product]


def one_round(image: Path, folder: Path, file: MotionFile, baud: int, speed: float) -> Round:
    """Measure all of them, one after the other."""
    mine = [by_product(image, folder / f"product{n}", file, baud, n, speed) for n in IN_FLIGHT[:2]]
    plain = [by_hand(image, folder / f"plain{n}", file, n, speed)[0] for n in IN_FLIGHT]
    rates, states, slipped = zip(*mine, strict=True)
    return Round(tuple(plain), rates, states, max(slipped))


def speed_rows(
    image: Path, folder: Path, baud: int, moves: int, rounds: int, speed: float
) -> Iterator[Row]:
    """Measure the product with one and two lines in flight beside plain hosts, turn by turn.

    A plain host with three lines in flight has one at the board all the time, so that only wire and
    firmware limit it. A board at a ``speed`` below 1 takes the host's own time out of the figure.
    """
    file, name = short_moves(moves), f"real Marlin, {baud} Bd, {moves} moves of 0.1 mm: "
    found = []
    for k in range(rounds):
        found.append(one_round(image, folder / str(k), file, baud, speed))
        print(f"{name}{found[-1]}", file=sys.stderr, flush=True)
    for n in IN_FLIGHT:
        rate = median(one.plain[n - 1] for one in found)
        yield row(name + f"plain host, {n} in flight", round(rate, 1), "1/s")
    done = all(state == "done" for one in found for state in one.states)
    slipped = max(one.slipped_s for one in found)
    for n in IN_FLIGHT[:2]:
        rate = median(one.product[n - 1] for one in found)
        text = f"printctl, lines_in_flight {n}, board's speed {speed:g} (slipped {slipped} s)"
        yield row(name + text, round(rate, 1), "1/s")
        share = median(one.shares[n - 1] for one in found)
        goal = ("\u2265 0.9", done and share >= 0.9) if n == 2 else ()
        yield row(name + f"the same over the best plain host, {n}", round(share, 3), "", *goal)
