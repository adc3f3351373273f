"""Time from an operator's kill or stop to the motors' last step, at three moments of a print."""

from __future__ import annotations

import json
import math
import socket
import statistics
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.common import Row, limited, row
from benchmarks.firmware.board import AvrBoard, StepLog
from benchmarks.firmware.files import MARLIN_STEPS, raster
from benchmarks.firmware.product import (
    attend,
    command,
    end_of,
    environment,
    records,
    run_folder,
)

MOMENT_GOAL_MS = 150.0
MOMENTS = ("a pause being made", "the needle coming down again", "the last moves")


@dataclass(frozen=True)
class Stopped:
    """What a board did after a stop was requested.

    ``last_ms``: until the last step sideways, of Z downwards or of E forwards; ``right``: the print
    ended as stopped, Z didn't go down after the goal, the plunger is relieved as it should be.
    """

    last_ms: float
    right: bool


def ask(job: Path, what: str) -> None:
    """Ask the print's own process for something, by its socket."""
    record = json.loads((run_folder(job) / "link.json").read_text())
    with socket.socket(socket.AF_UNIX) as client:
        client.connect(record["address"].removeprefix("unix:"))
        request = {"do": what, "answer": True, "token": record["token"]}
        client.sendall(json.dumps(request).encode() + b"\n")
        client.recv(1)


def wait_for(job: Path, state: str, within_s: float = 60.0) -> None:
    """Wait until the journal has a state."""
    until = time.monotonic() + within_s
    while time.monotonic() < until:
        states = [one.get("state") for one in records(run_folder(job)) if one.get("t") == "state"]
        if state in states:
            return
        time.sleep(0.01)


def come_to(moment: str, job: Path, lines: int) -> None:
    """Bring a print to a moment."""
    wait_for(job, "printing")
    if moment == MOMENTS[2]:
        while not any(one.get("done") == lines for one in records(run_folder(job))):
            time.sleep(0.01)
        time.sleep(0.5)
        return
    time.sleep(1.5)
    ask(job, "pause")
    wait_for(job, "pausing")
    if moment == MOMENTS[1]:
        wait_for(job, "paused")
        ask(job, "resume")
        wait_for(job, "resuming")
    time.sleep(1.0)


def judge_stop(log: StepLog, asked_ns: int, wanted: int, state: str) -> Stopped:
    """Read from the edges what the motors did."""
    wrong = {"X": (1, -1), "Y": (1, -1), "Z": (-1,), "E": (1,)}
    last = asked_ns
    for axis, directions in wrong.items():
        steps = log.steps(axis)
        late = steps[(steps["ns"] > asked_ns) & [one in directions for one in steps["direction"]]]
        last = max([last, *(int(ns) for ns in late["ns"])])
    z = log.steps("Z")
    down = int(((z["ns"] > asked_ns + MOMENT_GOAL_MS * 1e6) & (z["direction"] < 0)).sum())
    e = log.steps("E")["direction"].astype(int).cumsum()
    right = state == "stopped" and not down and abs(int(e.max() - e[-1]) - wanted) <= 1
    return Stopped((last - asked_ns) / 1e6, right)


def stop_at(moment: str, image: Path, folder: Path) -> Stopped:
    """Print, and stop at a moment."""
    folder.mkdir(parents=True, exist_ok=True)
    file = raster(20, width_mm=20.0)
    job = file.write(folder / "stop.gcode")
    with AvrBoard(image, folder / "board") as board:
        process = subprocess.Popen(
            command(job, board.port, "marlin_avr"), stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment(folder),
        )  # fmt: skip
        come_to(moment, job, len(file.lines))
        asked_ns = time.monotonic_ns()
        ask(job, "stop")
        try:
            process.wait(60)
        except subprocess.TimeoutExpired:
            process.kill()
        time.sleep(1.0)
        state = str((end_of(run_folder(job)) or {}).get("state", "hangs"))
        record = json.loads((run_folder(job) / "link.json").read_text())
        wanted = round(record["retreat"]["relief_mm"] * MARLIN_STEPS["E"])
        return judge_stop(board.log(), asked_ns, wanted, state)


def moment_rows(image: Path, folder: Path, tries: int, build: str) -> Iterator[Row]:
    """Measure stops at each moment."""
    for number, moment in enumerate(MOMENTS):
        found = [stop_at(moment, image, folder / f"{number}-{turn}") for turn in range(tries)]
        name = f"real Marlin, {build}, {tries} stops during {moment}: "
        longest = max(one.last_ms for one in found)
        measure = name + "request to last step of the job, longest"
        yield limited(measure, round(longest, 1), "ms", MOMENT_GOAL_MS)
        wrong = sum(not one.right for one in found)
        yield limited(name + "not stopped, lowered, or relieved wrongly", wrong, "stops", 0)


GOAL_MS = 1000.0
MOVE_MS = 1000.0
"""Of the longest move in the file: 20 mm at 20 mm/s."""


def stop_ms(image: Path, folder: Path, turn: int, letter: str, axes: str = "XYZE") -> float:
    """Return the time from the answered question to the last step edge, ms; infinite: no print.

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
                return math.inf
        asked = attended.choose(letter)
        attended.wait(40)
        time.sleep(1.0)
        steps = [board.log().steps(axis) for axis in axes]
        last = max(float(found["ns"].max()) / 1e9 for found in steps if len(found))
    return 1000 * (last - asked)


def stop_rows(image: Path, folder: Path, tries: int, build: str) -> Iterator[Row]:
    """Measure kills by Ctrl-C and k, stops by Ctrl-C and s."""
    kills = [stop_ms(image, folder, turn, "k") for turn in range(tries)]
    name = f"real Marlin, {build}, {tries} kills (Ctrl-C, k): answer to last step edge, "
    yield row(name + "median", round(statistics.median(kills), 1), "ms")
    yield limited(name + "longest", round(max(kills), 1), "ms", GOAL_MS)
    longest = max(stop_ms(image, folder, turn, "s", "XY") for turn in range(tries))
    name = f"real Marlin, {build}, {tries} controlled stops (Ctrl-C, s), moves of 1 s: "
    measure = name + "answer to last step edge of X or Y, longest"
    yield limited(measure, round(longest, 1), "ms", GOAL_MS + MOVE_MS)
    yield from moment_rows(image, folder / "moments", tries, build)
