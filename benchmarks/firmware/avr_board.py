"""Start, command and stop a Marlin image on the simulated RAMPS board (``board/avr_board.c``)."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import socket
import subprocess
import tempfile
import time
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any

from benchmarks.firmware.step_log import StepLog, read_step_log

SOURCES = Path(__file__).parent / "board"
LIBRARIES = ("-lsimavr", "-lelf", "-lm")
START_WITHIN_S = 20.0


class BoardError(RuntimeError):
    """The board can't be built, started or asked."""


@cache
def build_board() -> Path:
    """Compile the board program with the system's compiler and return its path.

    Raises
    ------
    BoardError
        If no C compiler, simavr or libelf is installed.
    """
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        raise BoardError("no C compiler (cc) is installed")
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
        raise BoardError(f"avr_board.c doesn't compile (libsimavr-dev, libelf-dev?): {reason}")
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
    options : tuple of str
        Further options of the program, e.g. ``--reset-on-open``.
    """

    image: Path
    folder: Path
    speed: float = 1.0
    options: tuple[str, ...] = ()
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
        self._process = subprocess.Popen([*command, *self.options], stdin=subprocess.DEVNULL)
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
