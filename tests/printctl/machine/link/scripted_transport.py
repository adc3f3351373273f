"""A transport for tests: another object plays the printer, and time is virtual."""

from __future__ import annotations

from collections.abc import Callable

from printctl.machine.ports.clock import VirtualClock
from printctl.machine.ports.detection import PortPrograms


class ScriptedTransport:
    """A wire whose far end is a function.

    Parameters
    ----------
    answer : callable
        Takes the bytes written and gives what the printer says to them, at once.
    clock : VirtualClock
        Moved on by a read that finds nothing.
    """

    quiet_s: float = 0.05
    stolen: int = 0

    def __init__(self, answer: Callable[[bytes], bytes], clock: VirtualClock) -> None:
        self.name = "fake"
        self.written: list[bytes] = []
        self.clock = clock
        self._answer = answer
        self.waiting = b""

    def programs(self) -> PortPrograms:
        """Give none."""
        return PortPrograms()

    def write(self, data: bytes) -> bool:
        """Hand ``data`` to the far end."""
        self.written.append(data)
        said = self._answer(data)
        self.waiting += said
        return True

    def write_urgent(self, data: bytes) -> bool:
        """Hand ``data`` to the far end."""
        return self.write(data)

    def write_halt(self, data: bytes) -> None:
        """Hand ``data`` to the far end."""
        self.write(data)

    def read(self, timeout: float) -> bytes:
        """Give what the far end has said; else let ``timeout`` pass."""
        self.clock.sleep(0.001 if self.waiting else timeout)
        data, self.waiting = self.waiting, b""
        return data

    def reset(self) -> bool:
        """Do nothing: there is no reset line."""
        return False

    def close(self) -> None:
        """Do nothing."""
