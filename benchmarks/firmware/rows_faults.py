"""Prints on a real Marlin through noise and faults: each move made once, or loss reported.

Judged by the places at which the motors of X and Y turned round, which pauses and lifts leave as
they are: a line that is lost, doubled or swapped changes them.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.common import Row, limited, printctl, row
from benchmarks.firmware.board import AvrBoard
from benchmarks.firmware.files import MARLIN_STEPS, random_moves
from benchmarks.firmware.product import (
    Attended,
    Judged,
    attend,
    end_of,
    environment,
    judge,
    print_file,
    records,
    run_folder,
    stand_still,
)

LOST_OKS = 0.01


def one_noisy(image: Path, folder: Path, seed: int, rate: float) -> Judged:
    """Print a file of random moves through noise."""
    folder.mkdir(parents=True, exist_ok=True)
    file = random_moves(1000 + seed, 40)
    job = file.write(folder / f"noise-{rate:g}-{seed}.gcode")
    with AvrBoard(image, folder / f"noisy-{rate:g}-{seed}") as board:
        board.tell(f"noise both {rate} {seed + 1}")
        board.tell(f"lostok {LOST_OKS}")
        ended = print_file(job, board.port, within_s=300)
        return judge(file, ended, board)


def noise_rows(image: Path, folder: Path, rate: float, runs: int) -> Iterator[Row]:
    """Measure how prints end, and whether those called done have the file's steps."""
    found = [one_noisy(image, folder, seed, rate) for seed in range(runs)]
    done = [one for one in found if one.ended.state == "done"]
    name = f"real Marlin, {runs} prints, {100 * rate:g} % of bytes garbled, 1 % of oks lost: "
    astray = sum(one.astray for one in done)
    yield limited(name + "done, but the motors stand elsewhere", astray, "prints", 0)
    doubled = sum(one.surplus != 0 for one in done if one.ended.pauses == 0)
    yield limited(name + "done without a pause, but with other steps", doubled, "prints", 0)
    early = sum(one.margin_s <= 0 for one in done)
    yield limited(name + "done before the last step", early, "prints", 0)
    others = len(found) - len(done)
    yield limited(name + "not done", others, "prints", 0 if rate < 0.001 else None)


MOVES = 25
LIMIT_S = 240.0


@dataclass
class Trial:
    """One print on one board, and the terminal where it was begun."""

    board: AvrBoard
    job: Path
    terminal: Attended

    def run(self, *words: str) -> None:
        """Run a command of the product on this print."""
        env = environment(self.job.parent)
        done = subprocess.run(
            printctl(*words), env=env, capture_output=True, text=True, check=False
        )
        if done.returncode not in (0, 4):
            print(f"{words[0]}: {done.stdout[-300:]} {done.stderr[-300:]}", file=sys.stderr)

    @property
    def folder(self) -> str:
        """Return where the print's journal is."""
        return str(run_folder(self.job))

    def state(self) -> str:
        """Return the journal's last state."""
        told = [one for one in records(run_folder(self.job)) if one.get("t") in ("state", "end")]
        return str(told[-1].get("state", "")) if told else ""

    def wait_for(self, *states: str, within_s: float = 40.0) -> bool:
        """Wait until the print is in one of the states."""
        until = time.monotonic() + within_s
        while self.state() not in states and time.monotonic() < until:
            self.terminal.read(0.05)
        return self.state() in states


def nothing(trial: Trial) -> None:
    """Let it print."""


def paused(trial: Trial) -> None:
    """Pause and resume."""
    trial.run("pause", trial.folder)
    trial.wait_for("paused")
    trial.run("resume", trial.folder)


def syringe(trial: Trial) -> None:
    """Pause, change the syringe and resume."""
    trial.run("pause", trial.folder)
    trial.wait_for("paused")
    trial.run("reload", trial.folder)
    time.sleep(3.0)
    trial.run("resume", trial.folder, "--plunger-mm", "1")


def link_killed(trial: Trial) -> None:
    """Kill the link with signal 9, and go on."""
    told = json.loads((run_folder(trial.job) / "link.json").read_text())
    os.kill(int(told["pid"]), signal.SIGKILL)
    time.sleep(1.0)
    trial.run("resume", trial.folder)


def unplugged(trial: Trial) -> None:
    """Pull the cable, put it back after 2 s, and go on."""
    trial.board.tell("cut")
    trial.wait_for("failed", within_s=20)
    time.sleep(2.0)
    trial.board.tell("plug")
    trial.run("resume", trial.folder)


def reset(trial: Trial) -> None:
    """Reset the board."""
    trial.board.tell("reset")


def stopped(trial: Trial) -> None:
    """Stop the print."""
    trial.terminal.choose("s")


EVENTS: dict[str, tuple[Callable[[Trial], None], str]] = {
    "lost oks": (nothing, "done"),
    "a pause": (paused, "done"),
    "a change of syringe": (syringe, "done"),
    "kill -9 of the link": (link_killed, "done"),
    "the cable out and in": (unplugged, "done"),
    "a reset": (reset, "position_unknown"),
    "a stop": (stopped, "stopped"),
}
"""What happens, and how the print must end."""


def turns(positions: list[int]) -> list[int]:
    """Return where a motor turned round and where it ended, steps."""
    places = np.asarray([0, *positions])
    places = places[np.append(True, np.diff(places) != 0)]
    signs = np.sign(np.diff(places))
    around = np.flatnonzero(np.diff(signs)) + 1
    return [*places[around].tolist(), int(places[-1])]


def one(image: Path, folder: Path, seed: int, event: str, rate: float) -> tuple[str, bool, float]:
    """Print; return how it ended, whether each turn is the file's, and the margin of the end, s.

    Of a print that ends early the turns before its last place count.
    """
    folder.mkdir(parents=True, exist_ok=True)
    file = random_moves(5000 + seed, MOVES)
    job = file.write(folder / f"{event.replace(' ', '_')}-{seed}.gcode")
    happens, wanted = EVENTS[event]
    with AvrBoard(image, folder / f"board-{job.stem}") as board:
        if rate:
            board.tell(f"noise both {rate} {seed + 1}")
        if event == "lost oks":
            board.tell("lostok 0.05")
        trial = Trial(board, job, attend(job, board.port))
        share = np.random.default_rng(seed).uniform(0.2, 0.8)
        until = time.monotonic() + LIMIT_S
        while board.positions()["E"] < share * file.targets[-1]["E"] * MARLIN_STEPS["E"]:
            trial.terminal.read(0.05)
            if time.monotonic() > until:
                break
        happens(trial)
        see_to_the_end(trial, until)
        stand_still(board)
        trial.terminal.wait(5.0)
        ended, log = end_of(run_folder(job)) or {}, board.log()
    margin = float(ended.get("at", 0)) - time.time() + time.monotonic() - log.last_edge_s()
    right = []
    for axis in "XY":
        made = turns(np.cumsum(log.steps(axis)["direction"].astype(int)).tolist())
        meant = turns([place[axis] for place in file.steps()])
        right.append(made == meant if wanted == "done" else made[:-1] == meant[: len(made) - 1])
    state = str(ended.get("state", "none"))
    return state, all(right), margin


def see_to_the_end(trial: Trial, until: float) -> None:
    """Wait for the end; go on where the line's noise has paused the print."""
    ends = ("done", "failed", "stopped", "killed", "position_unknown")
    while not trial.wait_for("paused", *ends, within_s=2.0) or trial.state() == "paused":
        if time.monotonic() > until:
            return
        if trial.state() == "paused":
            trial.run("resume", trial.folder)
            time.sleep(1.0)


def fault_rows(image: Path, folder: Path, runs: int, rate: float = 0.0004) -> Iterator[Row]:
    """Measure each event in so many prints through so much noise."""
    for event, (_, wanted) in EVENTS.items():
        place = folder / event.replace(" ", "_")
        found = [one(image, place, seed, event, rate) for seed in range(runs)]
        name = f"real Marlin, {runs} prints with {event}, {100 * rate:g} % of bytes garbled: "
        wrong = sum(not right for _, right, _ in found)
        yield limited(name + "a move lost, doubled or swapped", wrong, "prints", 0)
        others = sum(state != wanted for state, _, _ in found)
        yield limited(name + f"ended otherwise than {wanted}", others, "prints", 0)
        if wanted == "done":
            least = min((margin for state, _, margin in found if state == wanted), default=-1.0)
            measure = name + "done, after the last step, least"
            yield row(measure, round(least, 2), "s", "> 0", least > 0)
