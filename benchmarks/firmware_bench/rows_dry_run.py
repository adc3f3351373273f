"""Rows: the dry run's time and end position against a real Marlin's."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.firmware_bench.avr_board import AvrBoard
from benchmarks.firmware_bench.gcode_files import (
    MARLIN_STEPS,
    MotionFile,
    polygon,
    random_moves,
    raster,
)
from benchmarks.firmware_bench.product import dry_run, print_file
from benchmarks.firmware_bench.random_gcode import write_random
from benchmarks.firmware_bench.rows_done import stand_still
from benchmarks.firmware_bench.rows_speed import board_seconds
from benchmarks.firmware_bench.serial_host import SerialHost
from benchmarks.machine import row

Row = dict[str, Any]
TIME_GOAL = 0.001


def time_rows(image: Path, folder: Path) -> Iterator[Row]:
    """Compare the dry run's duration with the firmware's, from first to last step edge."""
    folder.mkdir(parents=True, exist_ok=True)
    files: dict[str, MotionFile] = {
        "raster": raster(30),
        "helix of chords": polygon(6),
        "random moves": random_moves(7, 60),
    }
    for name, file in files.items():
        job = file.write(folder / f"{name.replace(' ', '_')}.gcode")
        said = dry_run(job).get("duration_s", float("nan"))
        with AvrBoard(image, folder / f"board_{job.stem}") as board:
            ended = print_file(job, board.port)
            stand_still(board)
            took = board_seconds(board)
        error = said / took - 1 if took else float("nan")
        text = f"dry run against real Marlin ({took:.2f} s, {ended.state}), {name}"
        met = ended.state == "done" and abs(error) <= TIME_GOAL
        yield row(text, round(100 * error, 3), "%", f"± {100 * TIME_GOAL:g}", met)


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
        yield row(name + "refused by the dry run", verdicts.count("refused"), "files")
