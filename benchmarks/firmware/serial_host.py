"""Minimal serial host for querying firmware in the benchmark, independent of the product."""

from __future__ import annotations

import os
import select
import termios
import time
import tty
from pathlib import Path


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
