"""Run the product through its command line, as a user does."""

from __future__ import annotations

import json
import os
import pty
import select
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from fcntl import ioctl
from pathlib import Path
from termios import TIOCSCTTY
from typing import Any

from benchmarks.common import ROOT, printctl
from benchmarks.firmware.board import AvrBoard
from benchmarks.firmware.files import MotionFile

POLL_S = 0.02


@dataclass(frozen=True)
class Ended:
    """A print as the product reports it: its last journal record, ``hangs`` or ``refused``.

    ``ended_s``: when it was reported, on ``time.monotonic()``; ``pauses`` that were resumed.
    """

    state: str
    ended_s: float
    pauses: int


def environment(folder: Path) -> dict[str, str]:
    """Return an environment whose prints aren't the user's."""
    return os.environ | {"PRINTCTL_DATA": str(folder / "data"), "PYTHONPATH": str(ROOT)}


def records(run: Path) -> list[dict[str, Any]]:
    """Read the records of a print's journal; an unfinished last line is dropped."""
    path = run / "journal.log"
    if not path.exists():
        return []
    lines = path.read_text(errors="replace").split("\n")[:-1]
    return [json.loads(line.partition(" ")[2]) for line in lines if " " in line]


def end_of(run: Path) -> dict[str, Any] | None:
    """Return the journal's end record, if there is one."""
    return next((found for found in reversed(records(run)) if found.get("t") == "end"), None)


def command(job: Path, port: Path, profile: str, *more: str) -> list[str]:
    """Return the command that prints a file."""
    place = ["--port", str(port), "--printer", profile, "--folder", str(run_folder(job))]
    return [*printctl("print", job), *place, "--yes", *more]


def run_folder(job: Path) -> Path:
    """Return where the print's journal is."""
    return job.with_suffix(".print")


def print_file(
    job: Path,
    port: Path,
    profile: str = "marlin_avr",
    within_s: float = 300.0,
    meanwhile: Callable[[], None] = lambda: None,
) -> Ended:
    """Print a file, go on after each pause, and wait for the end; ``meanwhile`` runs at 50 Hz."""
    process = subprocess.Popen(
        command(job, port, profile, "--json"), stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment(job.parent),
    )  # fmt: skip
    pauses = _watch(process, job, within_s, meanwhile)
    code, now = process.poll(), time.monotonic()
    if code is None:
        process.kill()
    end = end_of(run_folder(job))
    if end is None:
        return Ended("hangs" if code is None else "refused", now, pauses)
    return Ended(end["state"], min(end["at"] - time.time() + time.monotonic(), now), pauses)


def _watch(
    process: subprocess.Popen[bytes], job: Path, within_s: float, meanwhile: Callable[[], None]
) -> int:
    """Wait for the process; resume whenever the print stands paused. Return how often."""
    until, pauses, seen, looked = time.monotonic() + within_s, 0, 0, 0.0
    while process.poll() is None and time.monotonic() < until:
        meanwhile()
        if time.monotonic() - looked > 0.5:
            looked = time.monotonic()
            states = [found for found in records(run_folder(job)) if found.get("t") == "state"]
            if len(states) > seen and states[-1].get("state") == "paused":
                seen, pauses = len(states), pauses + 1
                resume, env = printctl("resume", run_folder(job)), environment(job.parent)
                subprocess.run(resume, env=env, capture_output=True, check=False)
        time.sleep(POLL_S)
    return pauses


def dry_run_s(job: Path, profile: str) -> float:
    """Return the duration that ``simulate --json`` predicts, s; NaN where it refuses."""
    asked, env = printctl("simulate", job, "--printer", profile, "--json"), environment(job.parent)
    done = subprocess.run(asked, capture_output=True, text=True, check=False, env=env)
    return float(json.loads(done.stdout)["duration_s"]) if not done.returncode else float("nan")


@dataclass
class Attended:
    """A print watched in a terminal, to be stopped as a person does: Ctrl-C, then a letter."""

    process: subprocess.Popen[bytes]
    terminal: int
    text: bytes = b""

    def read(self, within_s: float) -> None:
        """Take in what is shown."""
        if select.select([self.terminal], [], [], within_s)[0]:
            try:
                self.text += os.read(self.terminal, 65536)
            except OSError:
                time.sleep(within_s)

    def choose(self, letter: str, within_s: float = 10.0) -> float:
        """Press Ctrl-C, wait for the question, answer; return when, s on ``time.monotonic()``."""
        os.write(self.terminal, b"\x03")
        until = time.monotonic() + within_s
        while b"\n> " not in self.text and time.monotonic() < until:
            self.read(0.05)
        answered = time.monotonic()
        os.write(self.terminal, letter.encode() + b"\n")
        return answered

    def wait(self, within_s: float) -> None:
        """Wait for the end of the command; kill it if it hangs."""
        until = time.monotonic() + within_s
        while self.process.poll() is None and time.monotonic() < until:
            self.read(0.05)
        if self.process.poll() is None:
            self.process.kill()
        os.close(self.terminal)


def attend(job: Path, port: Path, profile: str = "marlin_avr") -> Attended:
    """Begin a print in a terminal of its own."""
    host, inside = pty.openpty()
    process = subprocess.Popen(
        command(job, port, profile), stdin=inside, stdout=inside, stderr=inside,
        env=environment(job.parent), start_new_session=True,
        preexec_fn=lambda: ioctl(0, TIOCSCTTY, 0),
    )  # fmt: skip
    os.close(inside)
    return Attended(process, host)


@dataclass(frozen=True)
class Judged:
    """One print against its motors.

    ``margin_s``: from the last step edge to the reported end, negative is too early; ``astray``:
    a motor stands elsewhere than the file ends; ``surplus``: step edges beyond the file's.
    """

    ended: Ended
    margin_s: float
    astray: bool
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
    state, astray = board.state(), board.positions() != file.steps()[-1]
    made = sum(found["edges"] for found in state["axes"].values())
    margin_s = ended.ended_s - state["last_ns"] / 1e9
    return Judged(ended, margin_s, astray, made - file.edges())
