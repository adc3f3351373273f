"""Benchmark rows: a line that is dead for a time; when print or stop go on behind its return."""

from __future__ import annotations

import random
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import Row, row
from benchmarks.firmware.avr_board import AvrBoard
from benchmarks.firmware.gcode_files import HEAD, KLIPPER_HEAD, MotionFile
from benchmarks.firmware.held_line import HeldLine
from benchmarks.firmware.klipper_board import KlipperBoard
from benchmarks.firmware.product import command, environment, records, run_folder
from benchmarks.firmware.step_log import StepLog
from benchmarks.firmware.stop_moments import ask, wait_for

DEAD_S = (5.0, 25.0)
RETURN_S, STOP_S = 2.0, 1.0
"""Within which print and stop must go on behind the line's return (issue 58)."""
ASK_BEFORE_S = 2.0
"""A stop is asked for so long before the return."""


@dataclass(frozen=True)
class Returned:
    """What a board did behind the return of its line.

    Attributes
    ----------
    stood_s : float, s
        How long the motors had stood then.
    first_s, lift_s, last_xy_s : float, s
        From the return to the first step of any motor, of Z upwards, and to the last of X and Y;
        nan for none.
    state : str
        Of the journal's end.
    told : str
        Alarms of ink that stood still.
    """

    stood_s: float
    first_s: float
    lift_s: float
    last_xy_s: float
    state: str
    told: str


def ink_lines(head: list[str], moves: int) -> MotionFile:
    """Return moves of 0.1 s with E, to and fro, behind one of Z."""
    file = MotionFile(list(head))
    file.move(300, Z=0.5)
    for i in range(moves):
        file.move(600, X=1.0 + i % 2, Y=1.0 + 0.05 * i, E=round(0.002 * (i + 1), 4))
    return file


def board_of(image: Path, folder: Path) -> AbstractContextManager[AvrBoard | KlipperBoard]:
    """Return the board of an image, or of a folder with Klipper."""
    return KlipperBoard(image, folder) if image.is_dir() else AvrBoard(image, folder)


def one(image: Path, folder: Path, dead_s: float, stop: bool, seed: int) -> Returned:
    """Print through a dead line; ask for a stop meanwhile or not."""
    folder.mkdir(parents=True, exist_ok=True)
    klipper = image.is_dir()
    file = ink_lines(KLIPPER_HEAD if klipper else HEAD, 140)
    job = file.write(folder / "job.gcode")
    profile = "klipper_bioprinter" if klipper else "marlin_avr"
    with board_of(image, folder / "board") as board, HeldLine(board.port, folder / "line") as line:
        asked = command(job, line.port, profile)
        with (folder / "text").open("w") as text:
            process = subprocess.Popen(
                asked, stdin=subprocess.DEVNULL, stdout=text, stderr=text, env=environment(folder)
            )
            wait_for(job, "printing")
            time.sleep(3.0 + random.Random(seed).random())
            line.hold()
            time.sleep(dead_s - ASK_BEFORE_S)
            if stop:
                with suppress(OSError):  # the print has ended already: told as that
                    ask(job, "stop")
            time.sleep(ASK_BEFORE_S)
            line.release()
            back_ns = time.monotonic_ns()
            try:
                process.wait(60)
            except subprocess.TimeoutExpired:
                process.kill()
        time.sleep(1.0)
        found = judge(board.log(), back_ns, records(run_folder(job)))
    where = f"{image.name} {dead_s:g} s {'stop' if stop else 'print'}"
    print(f"{where}: {found}", file=sys.stderr, flush=True)
    return found


def judge(log: StepLog, back_ns: int, journal: list[Row]) -> Returned:
    """Read from the edges when the motors went on."""

    def since(steps: Any, last: bool = False) -> float:
        late = steps["ns"][steps["ns"] > back_ns]
        return (float(late.max() if last else late.min()) - back_ns) / 1e9 if len(late) else np.nan

    steps, z = log.steps(), log.steps("Z")
    before = steps["ns"][steps["ns"] <= back_ns]
    xy = steps[np.isin(steps["axis"], (0, 1))]
    ends = [found["state"] for found in journal if found.get("t") == "end"]
    told = [found["text"] for found in journal if found.get("t") == "alarm"]
    return Returned(
        stood_s=round((back_ns - float(before.max())) / 1e9, 2),
        first_s=round(since(steps), 2),
        lift_s=round(since(z[z["direction"] > 0]), 2),
        last_xy_s=round(since(xy, last=True), 2),
        state=ends[-1] if ends else "hangs",
        told="; ".join(text for text in told if "stood still" in text),
    )


def dead_line_rows(image: Path, folder: Path, tries: int, build: str) -> Iterator[Row]:
    """Measure prints that go on, and stops that are obeyed, behind a dead line."""
    for dead_s in DEAD_S:
        for stop in (False, True):
            name = f"{dead_s:g}-{'stop' if stop else 'print'}"
            found = [one(image, folder / f"{name}-{k}", dead_s, stop, k) for k in range(tries)]
            took = [one.lift_s if stop else one.first_s for one in found]
            longest, limit = float(np.max(took)), STOP_S if stop else RETURN_S
            what = "stop asked for meanwhile, needle lifted" if stop else "motors go on"
            yield row(
                f"{build}, line dead for {dead_s:g} s, {tries} times: {what} behind its return, "
                "longest", longest, "s", f"{limit:g}", longest <= limit,
            )  # fmt: skip
            wrong = sum(one.state != ("stopped" if stop else "done") for one in found)
            asked = "stopped" if stop else "done"
            yield row(f"{build}, line dead for {dead_s:g} s: ended otherwise than {asked}", wrong,
                      "prints", "0", not wrong)  # fmt: skip
