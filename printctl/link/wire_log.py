"""A log of what went over the wire: the last traffic in memory, and a file where one is asked for.

A line of the file: seconds since the port was opened (monotonic), ``>`` to the printer or
``<`` from it or ``!`` past the queue, and the bytes as a Python literal.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from pathlib import Path
from typing import Final, TextIO

from printctl.link.transport import Transport

RING_BYTES: Final = 256 * 1024
_OVERHEAD: Final = 32
FILE: Final = "wire.log"
FLUSH_S: Final = 0.5


class WireLog:
    """The last traffic, `RING_BYTES` at most.

    Parameters
    ----------
    path : Path, optional
        Everything goes there as well; a folder gets a file ``wire.log``.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._last: deque[tuple[float, str, bytes]] = deque()
        self._size, self._zero, self._lock = 0, time.monotonic(), threading.Lock()
        self._file: TextIO | None = None
        self._flush_due = 0.0
        if path is not None:
            path = path / FILE if path.is_dir() else path
            self._file = path.open("a", encoding="ascii", buffering=1 << 16)

    def add(self, sort: str, data: bytes) -> None:
        """Note bytes; from any thread."""
        at = time.monotonic() - self._zero
        with self._lock:
            self._last.append((at, sort, data))
            self._size += len(data) + _OVERHEAD
            while self._size > RING_BYTES:
                self._size -= len(self._last.popleft()[2]) + _OVERHEAD
            if self._file is not None:
                self._file.write(_line(at, sort, data))
                if at >= self._flush_due:  # a link that is killed leaves what it had
                    self._file.flush()
                    self._flush_due = at + FLUSH_S

    def keep(self, path: Path) -> None:
        """Write the last traffic to a file, in place of what it held."""
        with self._lock:
            lines = [_line(*one) for one in self._last]
        path.write_text("".join(lines), encoding="ascii")

    def close(self) -> None:
        """Let go of the file."""
        with self._lock:
            if self._file is not None:
                self._file.close()
                self._file = None


def _line(at: float, sort: str, data: bytes) -> str:
    return f"{at:12.6f} {sort} {data!r}\n"


class LoggedTransport:
    """A wire that is logged; see `printctl.link.transport.Transport`.

    Parameters
    ----------
    transport : Transport
    log : WireLog
    """

    def __init__(self, transport: Transport, log: WireLog) -> None:
        self._transport, self._log = transport, log
        self.name, self.quiet_s = transport.name, transport.quiet_s

    def write(self, data: bytes) -> None:
        """Write all of ``data``, or raise `PortLost` within the transport's time limit."""
        self._log.add(">", data)
        self._transport.write(data)

    def read(self, timeout: float) -> bytes:
        """Give what has come, waiting at most ``timeout`` s for it; empty for nothing."""
        data = self._transport.read(timeout)
        if data:
            self._log.add("<", data)
        return data

    def write_urgent(self, data: bytes) -> None:
        """Drop what hasn't left yet and write ``data`` at once, from any thread."""
        self._transport.write_urgent(data)
        self._log.add("!", data)

    def reset(self) -> bool:
        """Pulse the reset line; False where there is none."""
        self._log.add("!", b"(reset line)")
        return self._transport.reset()

    def close(self) -> None:
        """Let go of the wire; closing twice does no harm."""
        self._transport.close()
