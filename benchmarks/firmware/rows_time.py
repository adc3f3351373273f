"""Lines per second on a real Marlin against the line's capacity; the dry run against its clock."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

from benchmarks.common import Row, row
from benchmarks.firmware.board import AvrBoard, SerialHost
from benchmarks.firmware.files import HEAD, MotionFile, short_moves, validation_files
from benchmarks.firmware.product import dry_run_s, print_file, stand_still

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


def by_hand(image: Path, folder: Path, file: MotionFile, in_flight: int) -> float:
    """Send the file with a fixed number of lines in flight; return lines/s."""
    with AvrBoard(image, folder) as board:
        host, waiting = SerialHost(board.port), 0
        time.sleep(2.5)
        for line in ["M110 N0", *HEAD]:
            host.ask(line)
        for number, line in enumerate(file.lines[len(HEAD) :], 1):
            host.write(numbered(line, number))
            waiting += 1
            if waiting >= in_flight:
                host.wait_for_ok()
                waiting -= 1
        for _ in range(waiting):
            host.wait_for_ok()
        host.ask("M400", 30)
        os.close(host.fd)
        return (len(file.lines) - len(HEAD)) / board_seconds(board)


def by_product(
    image: Path, folder: Path, file: MotionFile, baud: int, in_flight: int
) -> tuple[float, str, float]:
    """Print the file; return lines/s, the state of its end and the time that slipped, s."""
    folder.mkdir(parents=True, exist_ok=True)
    job = file.write(folder / "speed.gcode")
    profile = write_profile(folder / "bench_printer.yaml", baud, [f"lines_in_flight: {in_flight}"])
    with AvrBoard(image, folder / "board") as board:
        ended = print_file(job, board.port, str(profile))
        stand_still(board)
        count, slipped = len(file.lines) - len(HEAD), board.state()["slipped_s"]
        return count / max(board_seconds(board), 1e-9), ended.state, slipped


def write_profile(path: Path, baud: int, more: Iterable[str] = ()) -> Path:
    """Write a printer profile of the benchmark's own for the images here."""
    facts = [
        "name: benchmark's Marlin",
        "source: benchmarks/firmware",
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


def speed_rows(image: Path, folder: Path, baud: int, moves: int, rounds: int) -> Iterator[Row]:
    """Measure the product with one and two lines in flight beside plain hosts, turn by turn.

    A plain host with three lines in flight has one at the board all the time, so that only wire and
    firmware limit it.
    """
    file, name = short_moves(moves), f"real Marlin, {baud} Bd, {moves} moves of 0.1 mm: "
    plain: dict[int, list[float]] = {n: [] for n in IN_FLIGHT}
    product: dict[int, list[float]] = {n: [] for n in IN_FLIGHT[:2]}
    states, slipped_s = set[str](), 0.0
    for place in (folder / str(k) for k in range(rounds)):
        for n, rates in product.items():
            rate, state, slipped = by_product(image, place / f"product{n}", file, baud, n)
            rates.append(rate)
            states.add(state)
            slipped_s = max(slipped_s, slipped)
        for n, rates in plain.items():
            rates.append(by_hand(image, place / f"plain{n}", file, n))
    for n, rates in plain.items():
        yield row(name + f"plain host, {n} in flight", round(median(rates), 1), "1/s")
    best = [max(each) for each in zip(*plain.values(), strict=True)]
    for n, rates in product.items():
        text = f"printctl, lines_in_flight {n} (slipped {slipped_s} s)"
        yield row(name + text, round(median(rates), 1), "1/s")
        share = median(rate / most for rate, most in zip(rates, best, strict=True))
        goal = ("\u2265 0.9", states == {"done"} and share >= 0.9) if n == 2 else ()
        yield row(name + f"the same over the best plain host, {n}", round(share, 3), "", *goal)


TIME_GOAL = 0.005
STARVED_FROM = {"900_short_segments": 0.52}
"""By file: share of the lines before those that the wire starves."""


@dataclass
class Turnaround:
    """The host's turnaround as the board sees it, from the first step to the last.

    ``skipped``: share of the turns that doesn't count: where the wire doesn't starve the planner,
    the turnaround changes nothing, and on a shared machine it differs from there to here. ``seen``:
    board's seconds between answers and next lines, and how many.
    """

    board: AvrBoard
    skipped: float = 0.0
    seen: list[tuple[float, int]] = field(default_factory=list)
    edges: int = 0

    def __call__(self) -> None:
        """Look while motors step."""
        state = self.board.state()
        edges = sum(axis["edges"] for axis in state["axes"].values())
        if edges > self.edges:
            self.seen.append((state["turned_s"], state["turns"]))
        self.edges = edges

    @property
    def mean_s(self) -> float:
        """Return the mean, s."""
        if not self.seen:
            return 0.0
        (_, begin), (until_s, end) = self.seen[0], self.seen[-1]
        counts = begin + self.skipped * (end - begin)
        from_s, turns = next(one for one in self.seen if one[1] >= counts)
        return (until_s - from_s) / max(end - turns, 1)


def one_time(image: Path, job: Path, baud: int, advanced_ok: bool) -> Row:
    """Print a file; return a row of the dry run's error against first to last step edge.

    The dry run takes the host's turnaround that the board saw in this very print: between the last
    byte of an answer and the first of the next line. On a loaded machine it differs from print to
    print by more than the model's error.
    """
    folder = job.parent
    profile = write_profile(folder / f"{job.stem}.yaml", baud)
    with AvrBoard(image, folder / f"board_{job.stem}") as board:
        seen = Turnaround(board, STARVED_FROM.get(job.stem, 0.0))
        ended = print_file(job, board.port, str(profile), 300, seen)
        stand_still(board)
        took, state, turnaround = board_seconds(board), board.state(), seen.mean_s
    more = [f"host_turnaround_s: {turnaround:.6f}", f"advanced_ok: {str(advanced_ok).lower()}"]
    write_profile(profile, baud, more)
    said = dry_run_s(job, str(profile))
    error = said / took - 1 if took else float("nan")
    text = f"dry run against real Marlin, {baud} Bd, {job.stem} ({took:.2f} s, {ended.state}, "
    text += f"turnaround {1000 * turnaround:.2f} ms, slipped {state['slipped_s']} s)"
    met = ended.state == "done" and abs(error) <= TIME_GOAL
    return row(text, round(100 * error, 3), "%", f"± {100 * TIME_GOAL:g}", met)


def time_rows(image: Path, folder: Path, baud: int, advanced_ok: bool) -> Iterator[Row]:
    """Compare the dry run's duration with the firmware's on files never used for tuning."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, make in validation_files().items():
        job = folder / f"{name.replace(' ', '_')}.gcode"
        job.write_text("\n".join(make()) + "\n")
        yield one_time(image, job, baud, advanced_ok)
