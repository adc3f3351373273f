"""Log of raw traffic with a printer: recent part in memory, optionally in a file.

A line of the file: seconds since the port was opened (monotonic), ``>`` to the printer or
``<`` from it or ``!`` past the queue, and the bytes as a Python literal. The first line (``#``)
says when second 0 was by the wall clock, s since 1970, as in the journal's records.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import Final, TextIO

from printctl.machine.ports.detection import PortPrograms
from printctl.machine.ports.transport import Transport

RING_BYTES: Final = 256 * 1024
_OVERHEAD_BYTES: Final = 32
_MAX_ENTRIES: Final = RING_BYTES // _OVERHEAD_BYTES
_LONG_BYTES: Final = 512
"""Entries longer than that could outgrow memory, and are rare."""
FILE: Final = "wire.log"
FLUSH_S: Final = 0.5
_Note = tuple[float, str, bytes]


class WireLog:
    """The last traffic, `RING_BYTES` at most.

    Everything goes to a file ``path`` as well, where given; a folder gets a file ``wire.log``.
    ``lost`` says why nothing more is written to it (disk full); empty while it is.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._last: deque[_Note] = deque(maxlen=_MAX_ENTRIES)
        self._zero, self._lock = time.monotonic(), threading.Lock()
        self._began: _Note = (self._zero, "#", b"%.6f" % time.time())
        self._file: TextIO | None = None
        self._flush_due = 0.0
        self.lost = ""
        if path is not None:
            path = path / FILE if path.is_dir() else path
            self._file = path.open("a", encoding="ascii", buffering=1 << 16)
            self._write(self._began)

    def add(self, sort: str, data: bytes) -> None:
        """Note bytes; from any thread. Part of the link's hot path: twice a line."""
        note = time.monotonic(), sort, data
        self._last.append(note)  # atomic; what is too much for the limit is left out on keeping
        if len(data) > _LONG_BYTES:
            self._drop_oldest()
        if self._file is not None:
            self._write(note)

    def keep(self, path: Path) -> None:
        """Write the last traffic to a file, in place of what it held."""
        self._drop_oldest()
        lines = [self._line(note) for note in (self._began, *self._last.copy())]
        path.write_text("".join(lines), encoding="ascii")

    def _drop_oldest(self) -> None:
        """Forget what is more than `RING_BYTES`."""
        with self._lock:
            size = sum(len(data) + _OVERHEAD_BYTES for _, _, data in self._last.copy())
            while size > RING_BYTES:
                size -= len(self._last.popleft()[2]) + _OVERHEAD_BYTES

    def _write(self, note: _Note) -> None:
        with self._lock:
            if self._file is None:
                return
            try:
                self._file.write(self._line(note))
                if note[0] >= self._flush_due:  # a link that is killed leaves what it had
                    self._file.flush()
                    self._flush_due = note[0] + FLUSH_S
            except OSError as exc:  # a print, and above all a kill, goes on without its log
                self._let_go(str(exc))

    def _line(self, note: _Note) -> str:
        at, sort, data = note
        return f"{at - self._zero:12.6f} {sort} {data!r}\n"

    def close(self) -> None:
        """Let go of the file."""
        with self._lock:
            self._let_go()

    def _let_go(self, lost: str = "") -> None:
        file, self._file, self.lost = self._file, None, self.lost or lost
        if file is not None:
            with suppress(OSError):
                file.close()


class LoggedTransport:
    """A wire that is logged; see `printctl.machine.ports.transport.Transport`."""

    def __init__(self, transport: Transport, log: WireLog) -> None:
        self._transport, self._log = transport, log
        self._read, self._write, self._note = transport.read, transport.write, log.add
        self.name, self.quiet_s = transport.name, transport.quiet_s

    @property
    def stolen(self) -> int:
        """Times that another program read what had come."""
        return self._transport.stolen

    def programs(self) -> PortPrograms:
        """Find the other programs that have the port open."""
        return self._transport.programs()

    def write(self, data: bytes) -> bool:
        """Write all of ``data``, or raise `PortLost` within the transport's time limit."""
        self._note(">", data)
        return self._write(data) or self._withheld()

    def read(self, timeout: float) -> bytes:
        """Give what has come, waiting at most ``timeout`` s for it; empty for nothing."""
        data = self._read(timeout)
        if data:
            self._note("<", data)
        return data

    def write_urgent(self, data: bytes) -> bool:
        """Drop what hasn't left yet and write ``data`` at once."""
        self._note("!", data)
        return self._transport.write_urgent(data) or self._withheld()

    def write_halt(self, data: bytes) -> None:
        """Drop what hasn't left yet, write ``data`` at once, take nothing else; any thread."""
        self._transport.write_halt(data)
        self._log.add("!", data)

    def _withheld(self) -> bool:
        self._note("!", b"(a halt has begun: the bytes before this didn't leave, or not wholly)")
        return False

    def reset(self) -> bool:
        """Pulse the reset line; False where there is none."""
        self._log.add("!", b"(reset line)")
        return self._transport.reset()

    def close(self) -> None:
        """Let go of the wire; closing twice does no harm."""
        self._transport.close()
