"""Marlin image on the simulated RAMPS board: start it, command it, read its steps."""

from __future__ import annotations

import contextlib
import json
import os
import select
import shutil
import socket
import subprocess
import tempfile
import termios
import time
import tty
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import SkippedError

AXES = "XYZE"
KINDS = ("step", "reset", "power_off", "power_on", "mark", "stall", "heater", "enable")
_FIELDS = (("cycle", "<u8"), ("ns", "<u8"), ("position", "<i4"), ("axis", "u1"))
_FLAGS = (("direction", "i1"), ("enabled", "u1"), ("kind", "u1"))
RECORD = np.dtype([*_FIELDS, *_FLAGS])
"""Times in cycles of the processor and in ns of the host's monotonic clock."""
Records = NDArray[np.void]


@dataclass(frozen=True)
class StepLog:
    """Events of a board, (n,) of RECORD, in the order in which they happened."""

    records: Records

    def steps(self, axis: str | None = None) -> Records:
        """Return the step edges that moved a motor, of one axis or of all."""
        moved = (self.records["kind"] == KINDS.index("step")) & (self.records["enabled"] == 1)
        if axis is not None:
            moved &= self.records["axis"] == AXES.index(axis)
        found: Records = self.records[moved]
        return found

    def last_edge_s(self) -> float:
        """Return the time of the last motor step, s on ``time.monotonic()``; 0 if none."""
        return float(self.steps()["ns"].max(initial=0)) / 1e9


def read_step_log(path: Path) -> StepLog:
    """Read a log; a torn last record and room not yet written are dropped."""
    whole = path.stat().st_size // RECORD.itemsize
    records = np.memmap(path, RECORD, "r", shape=(whole,)) if whole else np.empty(0, RECORD)
    end = int(np.searchsorted(records["ns"] == 0, True)) if whole else 0
    return StepLog(np.array(records[:end]))


class SerialHost:
    """A plain host at a pseudo-terminal: lines out, oks in."""

    def __init__(self, port: Path) -> None:
        self.fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.fd, termios.TCSANOW)
        self.rest = b""

    def write(self, text: str) -> None:
        """Write a line."""
        data = text.encode() + b"\n"
        while data:
            data = data[os.write(self.fd, data) :]

    def wait_for_ok(self, within_s: float = 20.0) -> None:
        """Read up to the next ``ok``; raise TimeoutError if none comes."""
        until = time.monotonic() + within_s
        while True:
            line, end, rest = self.rest.partition(b"\n")
            if end:
                self.rest = rest
                if line.strip().startswith(b"ok"):
                    return
                continue
            left = max(until - time.monotonic(), 0.0)
            if not select.select([self.fd], [], [], left)[0]:
                raise TimeoutError(f"no ok within {within_s} s; had {self.rest!r}")
            self.rest += os.read(self.fd, 4096)

    def ask(self, text: str, within_s: float = 10.0) -> None:
        """Write a line and wait for its ``ok``."""
        self.write(text)
        self.wait_for_ok(within_s)


SOURCES = Path(__file__).parent / "board_in_c"
START_WITHIN_S = 20.0


class BoardError(RuntimeError):
    """The board can't be started or asked."""


@cache
def build_board() -> Path:
    """Compile the board program and return its path; skip without compiler, simavr or libelf."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        raise SkippedError("needs a C compiler (cc)")
    program = Path(tempfile.mkdtemp(prefix="avr_board_")) / "avr_board"
    sources = sorted(str(path) for path in SOURCES.glob("avr_*.c"))
    command = [compiler, "-O2", *sources, "-o", str(program), "-lsimavr", "-lelf", "-lm"]
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    if made.returncode:
        reason = made.stderr.strip().splitlines()[:1]
        raise SkippedError(f"needs libsimavr-dev and libelf-dev: {reason}")
    return program


@dataclass
class AvrBoard:
    """A running board with an ELF ``image``; its ``folder`` gets port, control socket and log."""

    image: Path
    folder: Path
    _process: subprocess.Popen[bytes] | None = field(default=None, repr=False)
    _socket: socket.socket | None = field(default=None, repr=False)
    _rest: bytes = field(default=b"", repr=False)

    @property
    def port(self) -> Path:
        """The serial port: a link to a pseudo-terminal."""
        return self.folder / "port"

    def __enter__(self) -> AvrBoard:
        """Start the board and wait until it answers on its control socket."""
        self.folder.mkdir(parents=True, exist_ok=True)
        control, log = self.folder / "control", self.folder / "steps.bin"
        paths = ["--port", str(self.port), "--control", str(control), "--log", str(log)]
        command = [str(build_board()), str(self.image), *paths, "--speed", "1"]
        self._process = subprocess.Popen(command, stdin=subprocess.DEVNULL)
        until = time.monotonic() + START_WITHIN_S
        while time.monotonic() < until and self._process.poll() is None:
            self._socket = socket.socket(socket.AF_UNIX)
            with contextlib.suppress(OSError):
                self._socket.connect(os.path.relpath(control))
                return self
            self._socket.close()
            time.sleep(0.05)
        raise BoardError(f"the board with {self.image} didn't start")

    def __exit__(self, *problem: object) -> None:
        """Stop the board; its log stays."""
        if self._socket is not None:
            self._socket.close()
        if self._process is not None:
            self._process.terminate()
            try:
                self._process.wait(10)
            except subprocess.TimeoutExpired:
                self._process.kill()

    def tell(self, command: str) -> dict[str, Any]:
        """Send a command line and return the board's answer, its state; raise BoardError."""
        if self._socket is None:
            raise BoardError("the board isn't running")
        self._socket.settimeout(10)
        self._socket.sendall(command.encode() + b"\n")
        while b"\n" not in self._rest:
            data = self._socket.recv(65536)
            if not data:
                raise BoardError(f"the board ended while it was told {command!r}")
            self._rest += data
        line, _, self._rest = self._rest.partition(b"\n")
        found: dict[str, Any] = json.loads(line)
        if not found.get("ok"):
            raise BoardError(f"{command!r}: {found.get('error')}")
        return found

    def state(self) -> dict[str, Any]:
        """Return counters, positions and times as the board has them now."""
        return self.tell("stat")

    def positions(self) -> dict[str, int]:
        """Return the motors' positions since the start, steps."""
        return {axis: found["position"] for axis, found in self.state()["axes"].items()}

    def log(self) -> StepLog:
        """Read the log as far as it has come."""
        self.tell("flush")
        return read_step_log(self.folder / "steps.bin")
