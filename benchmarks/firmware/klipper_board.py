"""Start and stop Klipper: klippy, and its micro-controller as a Linux process with stubbed pins."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any

from benchmarks.firmware.avr_board import BoardError
from benchmarks.firmware.klipper_config import start_steps, write_config
from benchmarks.firmware.step_log import StepLog, read_step_log

STUB = Path(__file__).parent / "board" / "gpio_stub.c"
READY_WITHIN_S = 60.0


@cache
def build_stub() -> Path:
    """Compile the pins' stub with the system's compiler and return the library's path."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        raise BoardError("no C compiler (cc) is installed")
    library = Path(tempfile.mkdtemp(prefix="gpio_stub_")) / "gpio_stub.so"
    command = [compiler, "-O2", "-shared", "-fPIC", str(STUB), "-o", str(library), "-ldl"]
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    if made.returncode:
        raise BoardError(f"gpio_stub.c doesn't compile: {made.stderr.strip().splitlines()[:1]}")
    return library


@dataclass
class KlipperBoard:
    """A running Klipper; use it as a context manager.

    Parameters
    ----------
    home : Path
        Holds ``klipper.elf`` (the Linux process), ``klippy/`` and ``python`` (its interpreter).
    folder : Path
        For ports, sockets, configuration and logs.
    """

    home: Path
    folder: Path
    _mcu: subprocess.Popen[bytes] | None = field(default=None, repr=False)
    _klippy: subprocess.Popen[bytes] | None = field(default=None, repr=False)

    @property
    def port(self) -> Path:
        """Klippy's virtual serial port."""
        return self.folder / "printer"

    @property
    def api(self) -> Path:
        """Klippy's API socket."""
        return self.folder / "api"

    def __enter__(self) -> KlipperBoard:
        """Start both processes and wait until Klipper says that it is ready."""
        self.folder.mkdir(parents=True, exist_ok=True)
        (self.folder / "steps.bin").unlink(missing_ok=True)
        self.start_mcu()
        (self.folder / "temperature").write_text("25000\n")
        config = self.folder / "printer.cfg"
        write_config(config, self.folder / "mcu", self.folder / "temperature")
        program = [str(self.home / "python"), str(self.home / "klippy" / "klippy.py"), str(config)]
        places = ["-I", str(self.port), "-a", str(self.api), "-l", str(self.folder / "klippy.log")]
        self._klippy = subprocess.Popen([*program, *places], stdin=subprocess.DEVNULL)
        try:
            self.wait_ready()
        except BoardError:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop both processes; the logs stay."""
        for process in (self._klippy, self._mcu):
            if process is not None and process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.terminate()
                try:
                    process.wait(5)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()

    def start_mcu(self) -> None:
        """Start the micro-controller's process, again after ``kill_mcu``."""
        stub = {
            "LD_PRELOAD": str(build_stub()),
            "GPIO_STUB_LOG": str(self.folder / "steps.bin"),
            "GPIO_STUB_START": start_steps(),
        }
        command = [str(self.home / "klipper.elf"), "-I", str(self.folder / "mcu")]
        command += ["-r"] if os.geteuid() == 0 else []  # real-time priority, as on a printer
        self._mcu = subprocess.Popen(command, env=os.environ | stub, stdin=subprocess.DEVNULL)

    def kill_mcu(self) -> None:
        """End the micro-controller at once, as a loss of power does."""
        if self._mcu is not None:
            self._mcu.kill()
            self._mcu.wait()

    def stall(self, seconds: float, mcu: bool = True) -> None:
        """Stop the micro-controller's process (or klippy) for a time, and let it go on."""
        process = self._mcu if mcu else self._klippy
        if process is not None:
            process.send_signal(signal.SIGSTOP)
            time.sleep(seconds)
            process.send_signal(signal.SIGCONT)

    def ask(self, method: str, **params: Any) -> dict[str, Any]:
        """Ask klippy's API, e.g. ``ask("objects/query", objects={"motion_report": None})``."""
        with socket.socket(socket.AF_UNIX) as api:
            api.settimeout(10)
            api.connect(str(self.api))
            api.sendall(
                json.dumps({"id": 1, "method": method, "params": params}).encode() + b"\x03"
            )
            data = b""
            while not data.endswith(b"\x03"):
                part = api.recv(65536)
                if not part:
                    raise BoardError("klippy's API closed")
                data += part
        found: dict[str, Any] = json.loads(data.rstrip(b"\x03").split(b"\x03")[-1])
        return found

    def wait_ready(self) -> None:
        """Wait until klippy is ready; BoardError with its reason if it isn't in time."""
        until, why = time.monotonic() + READY_WITHIN_S, "klippy doesn't answer"
        while time.monotonic() < until:
            try:
                info = self.ask("info").get("result", {})
            except OSError:
                info = {}
            if info.get("state") == "ready":
                return
            why = info.get("state_message", why)
            time.sleep(0.2)
        raise BoardError(f"Klipper isn't ready: {why}")

    def log(self) -> StepLog:
        """Read the log of steps as far as it has come."""
        return read_step_log(self.folder / "steps.bin")

    def positions(self) -> dict[str, int]:
        """Return the motors' positions since the start, steps."""
        return self.log().positions()
