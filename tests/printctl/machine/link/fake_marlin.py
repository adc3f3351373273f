"""Fake Marlin for link tests: accepts, refuses and answers lines like the recorded one.

With a generator it also empties its receive buffer in mid-line when it refuses a line.

No motion and no time: what matters here is which lines it executed, in which order. Its faults
are drawn from the generator that it is given. (The whole printer is `sim`'s.)
"""

from __future__ import annotations

import os
import re
import select
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import reduce
from operator import xor
from pathlib import Path

import numpy as np
import pytest

from printctl.machine.ports.clock import VirtualClock
from tests.printctl.machine.link.scripted_transport import ScriptedTransport


class FakeMarlin:
    """Bytes in by `receive`, bytes out as its return value."""

    end = "\n"

    def __init__(self, rng: np.random.Generator | None = None) -> None:
        self.rng = rng
        self.last = 0
        self.executed: list[str] = []
        self.numbered: list[str] = []
        self.tokens: list[str] = []
        self.by_number: dict[int, str] = {}
        self.halted = False
        self.mute = False
        self.firmware = "Marlin 2.1.2"
        self.steps = "  M92 X80.00 Y80.00 Z400.00 E6400.00"
        self.at = {"X": 0.0, "Y": 0.0, "Z": 0.0, "E": 0.0}
        self.renamed_mm = dict.fromkeys("XYZE", 0.0)
        self.reset_at = -1
        self.keepalive = True
        self._rest = b""

    def receive(self, data: bytes) -> bytes:
        self._rest += data
        out = b""
        while b"\n" in self._rest:
            line, self._rest = self._rest.split(b"\n", 1)
            if line.strip() and not self.halted:
                out += self._take(line.decode("latin-1").strip())
        return b"" if self.mute else out

    def reset(self) -> bytes:
        self.last, self.halted, self._rest = 0, False, b""
        return b"start\nMarlin 2.1.2\necho: Last Updated: 2024\n"

    def _take(self, line: str) -> bytes:
        number = re.match(r"N(-?\d*)", line)
        if number is None:
            return self._do(line)
        n = int(number[1] or 0)
        renumber = re.search(r"M110.*N(\d+)", line)
        if renumber:
            n = int(renumber[1])
        elif n != self.last + 1:
            if n in (self.last - 1, self.last):
                return b""
            return self._refuse("Line Number is not Last Line Number+1")
        body, star, checksum = line.rpartition("*")
        if not star:
            return self._refuse("No Checksum with line number")
        found = re.match(r" *(\d+)", checksum)
        if (int(found[1]) if found else 0) != reduce(xor, body.encode("latin-1")):
            return self._refuse("checksum mismatch")
        self.last = n
        command = re.sub(r"^M0+(?=\d)", "M", body[number.end() :].strip())  # a number is a number
        self.by_number[n] = command
        if command.startswith("M118 E1 "):
            self.tokens.append(command)
        elif not renumber:
            self.numbered.append(command)
        if not renumber and self.reset_at == n:
            return self.reset()
        return self._do(command)

    def _refuse(self, why: str) -> bytes:
        if self.rng is not None and self._rest:  # what has arrived by now is thrown away
            self._rest = self._rest[self.rng.integers(0, len(self._rest) + 1) :]
        return f"Error:{why}, Last Line: {self.last}\nResend: {self.last + 1}\nok\n".encode()

    def _do(self, command: str) -> bytes:
        self.executed.append(command)
        word = command.split()[0].split("*")[0] if command.split() else ""
        for axis, value in re.findall(r"([XYZE])(-?[\d.]+)", command):
            if word == "G92":
                self.renamed_mm[axis] += float(value) - self.at[axis]
            if word in ("G0", "G1", "G92"):
                self.at[axis] = float(value)
        if word == "M112":
            self.halted = True
            return b"echo:M112 Shutdown\nError:Printer halted. kill() called!\n//action:poweroff\n"
        return self._reply(word, command).encode("latin-1")

    def _reply(self, word: str, command: str) -> str:
        if word == "M118":
            return f"echo:{command.removeprefix('M118 E1 ')}\nok\n"
        if word == "M105":
            return "ok T:21.00 /0.00 B:21.00 /0.00 @:0 B@:0\n"
        if word == "M115":
            return f"FIRMWARE_NAME:{self.firmware} SOURCE_CODE_URL:x\nCap:EMERGENCY_PARSER:1\nok\n"
        if word == "M113":
            return "ok\n" if " S" in command or not self.keepalive else "echo:M113 S1\nok\n"
        if word == "M92":
            return f"{self.steps}\nok\n"
        if word in ("M114", "G92"):
            where = " ".join(f"{axis}:{value:.2f}" for axis, value in self.at.items())
            counts = (
                f"{axis}:{round((self.at[axis] - self.renamed_mm[axis]) * per_mm)}"
                for axis, per_mm in (("X", 80), ("Y", 80), ("Z", 400))
            )
            return f"{where} Count {' '.join(counts)}\nok\n"
        if word == "COLD":
            return "echo: cold extrusion prevented\nok\n"
        if not re.match(r"[GMT]\d{1,3}$", word) or word == "G999":
            return f'echo:Unknown command: "{command}"\nok\n'
        return "ok\n"


def slips_through(before: bytes, after: bytes) -> bool:
    """Whether a line was changed in a way that its checksum doesn't show.

    An XOR doesn't see two flips of the same bit, and a checksum without digits reads 0.
    """
    if before == after:
        return False
    meant = {line.rpartition(b"*")[0] for line in before.split(b"\n")}
    for line in after.split(b"\n"):
        body, star, checksum = line.rpartition(b"*")
        digits = re.match(rb"\s*([+-]?\d+)", checksum)
        said = int(digits[1]) if digits else 0
        if star and body[:1] == b"N" and body not in meant and said == reduce(xor, body):
            return True
    return False


class FakeTransport(ScriptedTransport):
    """A wire to a `FakeMarlin` in virtual time."""

    def __init__(self, printer: FakeMarlin, clock: VirtualClock) -> None:
        super().__init__(printer.receive, clock)
        self.printer = printer

    def reset(self) -> bool:
        self.waiting += self.printer.reset()
        return True


class PtyPrinter:
    """A `FakeMarlin` behind a real pseudo-terminal, served by a thread.

    It goes away when line ``unplug_at`` is taken. From line ``hold_at`` on it holds its answers
    back until ``gate`` is set; ``held`` says that it does. It takes ``pace_s`` for each answer.
    """

    def __init__(
        self, printer: FakeMarlin, unplug_at: int | None, hold_at: int | None, pace_s: float = 0.0
    ) -> None:
        self.printer, self.unplug_at, self.hold_at = printer, unplug_at, hold_at
        self.pace_s = pace_s
        self._master, self._slave = os.openpty()
        self.name = os.ttyname(self._slave)
        self._over = threading.Event()
        self.held, self.gate = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        # Not select: beside thousands of open connections a descriptor may be beyond its 1024.
        readable = select.poll()
        readable.register(self._master, select.POLLIN)
        while not self._over.is_set():
            if not readable.poll(20):
                continue
            try:
                data = os.read(self._master, 4096)
            except OSError:
                return
            said = self.printer.receive(data)
            if self.unplug_at is not None and self.printer.last >= self.unplug_at:
                os.close(self._slave)
                os.close(self._master)
                self._master = self._slave = -1
                return
            if self.hold_at is not None and self.printer.last >= self.hold_at:
                self.held.set()
                self.gate.wait(10.0)
            if self.pace_s:
                self._over.wait(self.pace_s)
            os.write(self._master, said)

    def close(self) -> None:
        self._over.set()
        self.gate.set()
        self._thread.join(2.0)
        for fd in (self._master, self._slave):
            if fd >= 0:
                os.close(fd)


@contextmanager
def pty_printer(
    printer: FakeMarlin,
    unplug_at: int | None = None,
    hold_at: int | None = None,
    pace_s: float = 0.0,
) -> Iterator[PtyPrinter]:
    if not hasattr(os, "openpty"):
        pytest.skip("no pseudo-terminals here")
    served = PtyPrinter(printer, unplug_at, hold_at, pace_s)
    try:
        yield served
    finally:
        served.close()


def zigzag(count: int, e_per_line: float = 0.01) -> list[bytes]:
    """Job lines, each different from the next."""
    return [
        f"G1 X{20 + i % 7 * 3.5:.3f} Y{10 + i % 11 * 1.25:.3f} E{i * e_per_line:.5f} F600".encode()
        for i in range(count)
    ]


def write_job(path: Path, count: int) -> list[str]:
    lines = [b"G90", b"M82", b"G92 E0", b"G1 Z0.5 F300", *zigzag(count)]
    path.write_bytes(b"; a test\n" + b"\n".join(lines) + b"\n")
    return [line.decode() for line in lines]
