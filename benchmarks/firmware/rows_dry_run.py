"""Benchmark rows: simulated print time and end position against a real Marlin's."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.common import Row, row
from benchmarks.firmware.avr_board import AvrBoard
from benchmarks.firmware.dry_run_files import validation_files
from benchmarks.firmware.gcode_files import MARLIN_STEPS
from benchmarks.firmware.product import dry_run, print_file
from benchmarks.firmware.random_gcode import write_random
from benchmarks.firmware.rows_done import stand_still
from benchmarks.firmware.rows_speed import board_seconds, write_profile
from benchmarks.firmware.serial_host import SerialHost

TIME_GOAL = 0.005
STARVED_FROM = {"900_short_segments": 0.52}
"""By file: share of the lines before those that the wire starves."""


@dataclass
class Turnaround:
    """The host's turnaround as the board sees it, from the first step to the last.

    Attributes
    ----------
    skipped : float
        Share of the turns that doesn't count: where the wire doesn't starve the planner, the
        turnaround changes nothing, and on a shared machine it differs from there to here.
    seen : list of (float, int)
        Board's seconds between answers and next lines, and how many.
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


def one_time(image: Path, job: Path, baud: int, advanced_ok: bool, speed: float) -> Row:
    """Print a file; return a row of the dry run's error against first to last step edge.

    The dry run takes the host's turnaround that the board saw in this very print: between the last
    byte of an answer and the first of the next line. On a loaded machine it differs from print to
    print by more than the model's error; a ``speed`` of the board below 1 shortens it.
    """
    folder = job.parent
    profile = write_profile(folder / f"{job.stem}.yaml", baud)
    with AvrBoard(image, folder / f"board_{job.stem}", speed) as board:
        seen = Turnaround(board, STARVED_FROM.get(job.stem, 0.0))
        ended = print_file(job, board.port, str(profile), 300 / speed, seen)
        stand_still(board)
        took, state, turnaround = board_seconds(board), board.state(), seen.mean_s
    more = [f"host_turnaround_s: {turnaround:.6f}", f"advanced_ok: {str(advanced_ok).lower()}"]
    write_profile(profile, baud, more)
    said = dry_run(job, str(profile)).get("duration_s", float("nan"))
    error = said / took - 1 if took else float("nan")
    text = f"dry run against real Marlin, {baud} Bd, {job.stem} ({took:.2f} s, {ended.state}, "
    text += f"turnaround {1000 * turnaround:.2f} ms, board's speed {speed:g}, slipped "
    text += f"{state['slipped_s']} s)"
    print(f"{text}: {100 * error:+.3f} %", file=sys.stderr, flush=True)
    met = ended.state == "done" and abs(error) <= TIME_GOAL
    return row(text, round(100 * error, 3), "%", f"± {100 * TIME_GOAL:g}", met)


def time_rows(
    image: Path, folder: Path, baud: int, advanced_ok: bool, part: Path | None, speed: float
) -> Iterator[Row]:
    """Compare the dry run's duration with the firmware's on files never used for tuning."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, make in validation_files(part).items():
        job = folder / f"{name.replace(' ', '_')}.gcode"
        job.write_text("\n".join(make()) + "\n")
        yield one_time(image, job, baud, advanced_ok, speed)


@dataclass(frozen=True)
class Truth:
    """Where a real Marlin is after each line that a plain host sends it.

    Attributes
    ----------
    steps : dict
        By line number: steps of the motors.
    refused : list of str
        Lines to which the firmware answered with an error or as unknown.
    """

    steps: dict[int, dict[str, int]]
    refused: list[str]


def firmware_places(image: Path, folder: Path, job: Path) -> Truth:
    """Send a file line by line, all blanks as they are, as fast as it goes."""
    refused, steps = [], {}
    with AvrBoard(image, folder, 0.0) as board:
        host = SerialHost(board.port)
        time.sleep(1.5)
        host.ask("G92 X0 Y0 Z0 E0")
        for number, line in enumerate(job.read_text().splitlines(), 1):
            sent = line.split(";")[0]
            if sent.strip():
                said = host.ask(sent, 60) + host.ask("M400", 60)
                bad = [text for text in said if re.search("Unknown|Error", text)]
                refused += [f"{line.strip()} -> {text}" for text in bad]
            steps[number] = board.positions()
        host.close()
    return Truth(steps, refused)


def first_difference(truth: Truth, said: dict[int, dict[str, float]], job: Path) -> str:
    """Return the first line after which motors and dry run differ by more than a step, or ''."""
    lines = job.read_text().splitlines()
    for number, place in sorted(said.items()):
        for axis, value in place.items():
            steps, motor = value * MARLIN_STEPS[axis], truth.steps[number][axis]
            if abs(steps - motor) > 1.5:
                where = f"line {number} {lines[number - 1]!r}"
                return f"{where}: {axis} dry run {steps:.0f}, motor {motor} steps"
    return ""


def one_random(image: Path, folder: Path, seed: int, odd: bool) -> tuple[str, str]:
    """Compare one random file; return a verdict and what differs first."""
    folder.mkdir(parents=True, exist_ok=True)
    job = write_random(folder / f"random-{'odd' if odd else 'plain'}-{seed}.gcode", seed, 25, odd)
    truth = firmware_places(image, folder / f"{job.stem}.board", job)
    said = dry_run(job, out=folder / f"{job.stem}.out")
    if said["exit_code"]:
        return "refused", said["text"].strip().splitlines()[-1] if said["text"] else ""
    wrong = first_difference(truth, said["places"], job)
    return ("differs" if wrong else "same"), "; ".join([wrong, *truth.refused])


def random_rows(image: Path, folder: Path, files: int) -> Iterator[Row]:
    """Compare dry runs' end positions with a real Marlin's, plain and odd spelling."""
    for odd in (False, True):
        verdicts = []
        for seed in range(files):
            verdict, why = one_random(image, folder, seed, odd)
            verdicts.append(verdict)
            print(f"random {odd=} {seed}: {verdict} {why}", file=sys.stderr, flush=True)
        kind = "odd spelling" if odd else "plain spelling"
        name = f"{files} random files, {kind}: "
        bad = verdicts.count("differs")
        yield row(name + "dry run ends elsewhere than the motors", bad, "files", "0", bad == 0)
        refused = verdicts.count("refused")
        yield row(name + "refused by the dry run", refused, "files", "0", refused == 0)
