"""Wait until a port is ready or an alarm descriptor fires; uses poll where available."""

from __future__ import annotations

import select
import sys
from dataclasses import dataclass


@dataclass(frozen=True)
class Event:
    """What the port is ready for."""

    readable: bool = False
    hung_up: bool = False


_POLL_S = 2e-3
"""`poll` rounds shorter times up to whole milliseconds."""
_NOTHING = Event()
_READABLE = Event(readable=True)


def _event(flags: int) -> Event:
    return Event(bool(flags & select.POLLIN), bool(flags & select.POLLHUP))


class Waiter:
    """Waits for a file descriptor to be readable (and, if asked, writable), or for the alarm's.

    Parameters
    ----------
    alarm : int
        A descriptor that ends every wait when it becomes readable.
    """

    def __init__(self, alarm: int) -> None:
        self._alarm = alarm
        self._watched = -1
        self._poll = None if sys.platform == "win32" else select.poll()
        if self._poll is not None:
            self._poll.register(alarm, select.POLLIN)

    def wait(self, port: int, writes: bool, timeout_s: float) -> Event:
        """Wait for ``port`` (negative: for the alarm only); at most ``timeout_s``."""
        if self._poll is None:
            return self._select(port, writes, timeout_s)
        if 0 < timeout_s < _POLL_S:
            self._select(port, writes, timeout_s)
            timeout_s = 0.0  # it tells no hang-up; poll does
        if port != self._watched:
            if self._watched >= 0:
                self._poll.unregister(self._watched)
            if port >= 0:
                self._poll.register(port, select.POLLIN)
            self._watched = port
        if writes and port >= 0:
            self._poll.modify(port, select.POLLIN | select.POLLOUT)
        event = _NOTHING
        for at, flags in self._poll.poll(timeout_s * 1e3):
            if at == port:
                # The usual answer is made once: this runs for every line of a print.
                event = _READABLE if flags == select.POLLIN else _event(flags)
        if writes and port >= 0:
            self._poll.modify(port, select.POLLIN)
        return event

    def _select(self, port: int, writes: bool, timeout_s: float) -> Event:
        ports = [port] if port >= 0 else []
        ready, _, _ = select.select([*ports, self._alarm], ports if writes else [], [], timeout_s)
        return Event(port in ready)

    def forget(self) -> None:
        """The port was closed."""
        if self._watched >= 0 and self._poll is not None:
            self._poll.unregister(self._watched)
        self._watched = -1
