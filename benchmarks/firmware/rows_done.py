"""Benchmark rows: reported print end against the motors' last step, and the step counts."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.common import Row, row
from benchmarks.firmware.avr_board import AvrBoard
from benchmarks.firmware.gcode_files import MARLIN_STEPS, MotionFile, random_moves
from benchmarks.firmware.product import Ended, print_file


@dataclass(frozen=True)
class Judged:
    """One print against its motors.

    Attributes
    ----------
    ended : Ended
    margin_s : float, s
        From the last step edge to the product's report of the end; negative is too early.
    wrong_axes : list of str
        Whose motor stands elsewhere than the file says.
    surplus : int
        Step edges beyond those of the file, all axes; negative: too few.
    """

    ended: Ended
    margin_s: float
    wrong_axes: list[str]
    surplus: int


def stand_still(board: AvrBoard, still_s: float = 4.0, within_s: float = 60.0) -> None:
    """Wait until no motor has stepped for a while."""
    begun = time.monotonic()
    while time.monotonic() < begun + within_s:
        last = max(begun, board.state()["last_ns"] / 1e9)
        if time.monotonic() - last > still_s:
            return
        time.sleep(0.1)


def judge(file: MotionFile, ended: Ended, board: AvrBoard) -> Judged:
    """Compare the product's report with the motors once they stand still."""
    stand_still(board)
    state, wanted = board.state(), file.end_steps(MARLIN_STEPS)
    wrong = [axis for axis, found in board.positions().items() if found != wanted[axis]]
    made = sum(found["edges"] for found in state["axes"].values())
    surplus = made - sum(file.edges(MARLIN_STEPS).values())
    return Judged(ended, ended.ended_s - state["last_ns"] / 1e9, wrong, surplus)


@dataclass
class Stalls:
    """Set a stall of the board at a chosen moment of the print."""

    board: AvrBoard
    after_mm: float
    seconds: float
    done: bool = False

    def __call__(self) -> None:
        """Look whether the moment has come."""
        if self.done or not self.seconds:
            return
        if self.board.positions()["E"] > self.after_mm * MARLIN_STEPS["E"]:
            self.board.tell(f"stall {self.seconds:.2f}")
            self.done = True


def one_late(image: Path, folder: Path, seed: int) -> Judged:
    """Print on a board that is slow, stalls, and says its oks late."""
    rng = np.random.default_rng(seed)
    file = random_moves(seed, 30)
    job = folder / f"late-{seed}.gcode"
    folder.mkdir(parents=True, exist_ok=True)
    file.write(job)
    delays = np.where(rng.random(97) < 0.12, rng.uniform(0, 5000, 97), 0).astype(int)
    speed = float(rng.choice([1.0, 0.7, 0.5, 0.3]))
    with AvrBoard(image, folder / f"board-{seed}", speed) as board:
        end_e = file.targets[-1]["E"]
        stall = float(rng.uniform(3, 10)) if rng.random() < 0.6 else 0.0
        stalls = Stalls(board, float(rng.uniform(0.2, 0.95)) * end_e, stall)
        delayed = rng.random() < 0.7
        if delayed:
            board.tell("okdelay " + " ".join(map(str, delays)))
        ended = print_file(job, board.port, meanwhile=stalls, within_s=400)
        judged = judge(file, ended, board)
    say = f"late oks {delayed}, speed {speed}, stall {stall:.1f} s: {judged}"
    print(f"seed {seed}: {say}", file=sys.stderr, flush=True)
    return judged


def done_rows(image: Path, folder: Path, runs: int) -> Iterator[Row]:
    """Measure how the end is reported under late oks, stalls and slow boards."""
    all_runs = [one_late(image, folder, seed) for seed in range(runs)]
    done = [found for found in all_runs if found.ended.state == "done"]
    name = f"real Marlin, {runs} prints with late oks, stalls, boards at 0.3 to 1.0 of real time: "
    least = min((found.margin_s for found in done), default=float("nan"))
    yield row(name + "done, after the last step, least", round(least, 3), "s", "> 0", least > 0)
    wrong = sum(bool(found.wrong_axes or found.surplus) for found in done)
    yield row(name + "done with other steps than the file's", wrong, "prints", "0", wrong == 0)
    others = len(all_runs) - len(done)
    yield row(name + "ended otherwise than done", others, "prints", "0", others == 0)
