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
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import SkippedError

AXES = "XYZE"
KINDS = ("step", "reset", "power_off", "power_on", "mark", "stall", "heater", "enable")
RECORD = np.dtype(
    [
        ("cycle", "<u8"),
        ("ns", "<u8"),
        ("position", "<i4"),
        ("axis", "u1"),
        ("direction", "i1"),
        ("enabled", "u1"),
        ("kind", "u1"),
    ]
)


@dataclass(frozen=True)
class StepLog:
    """Events of a board in the order in which they happened.

    Attributes
    ----------
    records : (n,) structured array of RECORD
        Times in cycles of the processor and in ns of the host's monotonic clock.
    """

    records: NDArray[np.void]

    def of_kind(self, kind: str) -> NDArray[np.void]:
        """Return the records of one kind."""
        found: NDArray[np.void] = self.records[self.records["kind"] == KINDS.index(kind)]
        return found

    def steps(self, axis: str | None = None) -> NDArray[np.void]:
        """Return the step edges that moved a motor, of one axis or of all."""
        steps = self.of_kind("step")
        moved = steps["enabled"] == 1
        if axis is not None:
            moved &= steps["axis"] == AXES.index(axis)
        found: NDArray[np.void] = steps[moved]
        return found

    def positions(self) -> dict[str, int]:
        """Return the sum of steps by axis."""
        return {axis: int(self.steps(axis)["direction"].sum(dtype=np.int64)) for axis in AXES}

    def last_edge_s(self) -> float:
        """Return the time of the last motor step, s on ``time.monotonic()``; 0 if none."""
        steps = self.steps()
        return float(steps["ns"].max()) / 1e9 if len(steps) else 0.0


def read_step_log(path: Path) -> StepLog:
    """Read a log; a torn last record and room not yet written are dropped."""
    whole = path.stat().st_size // RECORD.itemsize
    records = np.memmap(path, RECORD, "r", shape=(whole,)) if whole else np.empty(0, RECORD)
    end = int(np.searchsorted(records["ns"] == 0, True)) if whole else 0
    return StepLog(np.array(records[:end]))


class SerialHost:
    """An open pseudo-terminal; lines out, lines in."""

    def __init__(self, port: Path) -> None:
        self.fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.fd, termios.TCSANOW)
        self.rest = b""

    def close(self) -> None:
        """Close the port."""
        os.close(self.fd)

    def write(self, text: str) -> None:
        """Write a line."""
        data = text.encode() + b"\n"
        while data:
            data = data[os.write(self.fd, data) :]

    def line(self, within_s: float) -> str | None:
        """Return the next line, or None when none came in time."""
        until = time.monotonic() + within_s
        while b"\n" not in self.rest:
            left = until - time.monotonic()
            if left <= 0 or not select.select([self.fd], [], [], left)[0]:
                return None
            self.rest += os.read(self.fd, 4096)
        found, _, self.rest = self.rest.partition(b"\n")
        return found.decode(errors="replace").strip()

    def wait_for(self, word: str, within_s: float) -> list[str]:
        """Return the lines up to one that begins with ``word``; TimeoutError if none comes."""
        until, lines = time.monotonic() + within_s, []
        while (left := until - time.monotonic()) > 0:
            line = self.line(left)
            if line is None:
                break
            lines.append(line)
            if line.startswith(word):
                return lines
        raise TimeoutError(f"no {word!r} within {within_s} s; had {lines[-3:]}")

    def ask(self, text: str, within_s: float = 10.0) -> list[str]:
        """Write a line and return what comes up to its ``ok``."""
        self.write(text)
        return self.wait_for("ok", within_s)


SOURCES = Path(__file__).parent / "board_in_c"
LIBRARIES = ("-lsimavr", "-lelf", "-lm")
START_WITHIN_S = 20.0


class BoardError(RuntimeError):
    """The board can't be started or asked."""


@cache
def build_board() -> Path:
    """Compile the board program with the system's compiler and return its path.

    Raises
    ------
    SkippedError
        If no C compiler, simavr or libelf is installed.
    """
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        raise SkippedError("needs a C compiler (cc)")
    program = Path(tempfile.mkdtemp(prefix="avr_board_")) / "avr_board"
    sources = sorted(str(path) for path in SOURCES.glob("avr_*.c"))
    made = subprocess.run(
        [compiler, "-O2", *sources, "-o", str(program), *LIBRARIES],
        capture_output=True,
        text=True,
        check=False,
    )
    if made.returncode:
        reason = made.stderr.strip().splitlines()[:1]
        raise SkippedError(f"needs libsimavr-dev and libelf-dev: {reason}")
    return program


@dataclass
class AvrBoard:
    """A running board; use it as a context manager.

    Parameters
    ----------
    image : Path
        ELF file of the firmware.
    folder : Path
        For the port, the control socket and the log.
    speed : float
        Share of real time; 0 is unpaced.
    """

    image: Path
    folder: Path
    speed: float = 1.0
    _process: subprocess.Popen[bytes] | None = field(default=None, repr=False)
    _socket: socket.socket | None = field(default=None, repr=False)
    _rest: bytes = field(default=b"", repr=False)

    @property
    def port(self) -> Path:
        """The serial port: a link to a pseudo-terminal."""
        return self.folder / "port"

    @property
    def log_path(self) -> Path:
        """The binary log."""
        return self.folder / "steps.bin"

    def __enter__(self) -> AvrBoard:
        """Start the board and wait until it answers on its control socket."""
        self.folder.mkdir(parents=True, exist_ok=True)
        control = self.folder / "control"
        paths = ["--port", str(self.port), "--control", str(control), "--log", str(self.log_path)]
        command = [str(build_board()), str(self.image), *paths, "--speed", str(self.speed)]
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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
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
        """Send a command line and return the board's answer, its state.

        Raises
        ------
        BoardError
            If the board doesn't know the command, or is gone.
        """
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
        return read_step_log(self.log_path)
