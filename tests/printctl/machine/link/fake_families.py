"""Fake RepRapFirmware and Klipper for link tests.

They take, drop and answer lines as their sources say (see each protocol's module). No motion and
no time; what matters is what they executed, in which order.
"""

from __future__ import annotations

import re
from functools import reduce
from operator import xor

PER_MM = {"X": 80, "Y": 80, "Z": 400}


def xmodem(data: bytes) -> int:
    """CRC-16 bit by bit: polynomial 0x1021, start 0."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    return crc


class FakePrinter:
    """Lines in by `receive`, answers out."""

    end = "\n"

    def __init__(self) -> None:
        self.executed: list[str] = []
        self.at = {"X": 0.0, "Y": 0.0, "Z": 0.0, "E": 0.0}
        self.halted = False
        self._rest = b""

    def receive(self, data: bytes) -> bytes:
        *lines, self._rest = (self._rest + data).split(b"\n")
        said = "".join(self.take(line) for line in lines if line.strip())
        return said.replace("\n", self.end).encode("latin-1")

    def take(self, line: bytes) -> str:
        raise NotImplementedError

    def moved(self, command: str) -> None:
        self.executed.append(command)
        if re.match(r"G(0|1|92)\b", command):
            for axis, value in re.findall(r"([XYZE])(-?[\d.]+)", command):
                self.at[axis] = float(value)

    @property
    def where(self) -> str:
        return " ".join(f"{axis}:{value:.3f}" for axis, value in self.at.items())


class FakeDuet(FakePrinter):
    """RepRapFirmware; from command ``stuck_at`` on its motors make no move."""

    def __init__(self) -> None:
        super().__init__()
        self.motors, self.stuck_at = dict(self.at), 1_000_000

    def moved(self, command: str) -> None:
        super().moved(command)
        if len(self.executed) < self.stuck_at:
            self.motors = dict(self.at)

    def accepts(self, line: bytes) -> str | None:
        """The command that would be done; None for a line that is dropped."""
        found = re.match(rb"N\d*[ \t]*", line)
        text = line
        if found:
            body, star, given = line.partition(b"*")
            digits = re.match(rb"\d*", given)
            count = len(digits[0]) if digits else 0
            wanted = {1: reduce(xor, body), 5: xmodem(body)}.get(5 if count == 5 else 1)
            if star and (count not in (1, 2, 3, 5) or int(given[:count]) != wanted):
                return None
            text = body[found.end() :]
        return text.decode("latin-1").strip()

    def take(self, line: bytes) -> str:
        command = self.accepts(line)
        return "" if command is None else self.do(command)

    def do(self, command: str) -> str:
        if not command:
            return ""
        word = command.split()[0]
        if word == "M112":
            self.halted = True
            return "Emergency Stop! Reset the controller to continue.\nok\n"
        self.moved(command)
        if word == "M114":
            count = " ".join(str(round(self.motors[a] * k)) for a, k in PER_MM.items())
            machine = " ".join(f"{self.at[a]:.3f}" for a in "XYZ")
            return f"{self.where} E0:0.0 Count {count} Machine {machine} Bed comp 0.000\nok\n"
        if word == "M115":
            name = "RepRapFirmware for Duet 3 MB6HC FIRMWARE_VERSION: 3.6.0"
            return f"FIRMWARE_NAME: {name} ELECTRONICS: Duet 3 MB6HC v1.02\nok\n"
        if word == "M92":
            return "Steps/mm: X: 80.000, Y: 80.000, Z: 400.000, E: 6400.000\nok\n"
        if word == "M105":
            return "T:21.0 /0.0 B:21.0 /0.0\nok\n"
        if word == "G999":
            return "Error: G999: Command is not supported\nok\n"
        return "ok\n"


class FakeKlipper(FakePrinter):
    """Klipper: numbers and checksums are ignored."""

    def take(self, line: bytes) -> str:
        text = re.sub(r"^N\d+\s*", "", line.decode("latin-1").strip()).split("*")[0].strip()
        word = text.split()[0] if text else ""
        if word == "M112":
            self.halted = True
            return "// Klipper state: Shutdown\nok\n"
        if self.halted:
            return "!! Shutdown due to M112 command\nok\n"
        if word == "M115":
            return "ok FIRMWARE_NAME:Klipper FIRMWARE_VERSION:v0.13.0\n"
        if word == "M105":
            return "ok B:21.0 /0.0 T0:21.0 /0.0\n"
        if not re.match(r"[GM]\d{1,3}$", word) or word == "G999":
            return f'// Unknown command:"{word}"\nok\n'
        far = re.search(r"X([\d.]+)", text)
        if word == "G1" and far and float(far[1]) > 500:
            return "!! Move out of range: 501.000 0.000 0.000 [0.000]\nok\n"
        self.moved(text)
        if word == "M114":
            return f"{self.where}\nok\n"
        return "ok\n"
