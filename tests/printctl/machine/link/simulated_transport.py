"""In-process transport to the simulated printer, for tests and benchmarks.

Clock and printer move together: what the host waits, the printer lives through, by its own pace
(`sim.devices.faults`). What the cable does to the bytes is `sim.devices.faults`'s.
"""

from __future__ import annotations

import numpy as np

from printctl.machine.errors import PortLost
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.ports.detection import PortPrograms
from sim.devices.board.printer import SimulatedPrinter
from sim.devices.faults import FaultyCable, Pace, PermanentFaults


class HostDiedError(BaseException):
    """In place of kill -9: nothing of the host runs after it."""


class SimulatedTransport:
    """See the module, and `printctl.machine.ports.transport.Transport`.

    Parameters
    ----------
    printer : SimulatedPrinter
    clock : VirtualClock
    troubles : PermanentFaults, optional
        Of the cable; it works as it should without.
    rng : Generator, optional
        Of what goes wrong by chance.
    """

    quiet_s: float = 0.05
    stolen: int = 0

    def __init__(
        self,
        printer: SimulatedPrinter,
        clock: VirtualClock,
        troubles: PermanentFaults | None = None,
        rng: np.random.Generator | None = None,
    ) -> None:
        self.name = "simulated"
        self.printer, self.clock = printer, clock
        self.line = printer.bad_line = FaultyCable(troubles, rng)
        if troubles is not None:
            printer.pace = Pace(troubles.speed)
        self._writes_left, self._last_part = 0, 1.0

    def die_at(self, write: int, part: float = 1.0) -> None:
        """Let the host die in a write to come, the next being 1, of which ``part`` still leaves."""
        self._writes_left, self._last_part = write, part

    def programs(self) -> PortPrograms:
        """See `Transport`: none."""
        return PortPrograms()

    def write(self, data: bytes) -> bool:
        """Give the printer what the cable leaves of ``data``; True: nothing holds it back.

        Raises
        ------
        PortLost
        HostDiedError
            As `die_at` says; the printer's answer, if any, reaches nobody.
        """
        self._check()
        self._writes_left -= 1
        dies = self._writes_left == 0
        if dies:
            data = data[: round(len(data) * self._last_part)]
        self._run_printer()
        self.printer.receive(self.on_the_way(data))
        if dies:
            self.printer.settle()
            self.printer.take_output()
            raise HostDiedError
        return True

    def write_urgent(self, data: bytes) -> bool:
        """Write; nothing waits here."""
        return self.write(data)

    def write_halt(self, data: bytes) -> None:
        """Write; nothing waits here."""
        self.write(data)

    def on_the_way(self, data: bytes) -> bytes:
        """What becomes of the host's bytes."""
        return self.line.down(data)

    def read(self, timeout: float) -> bytes:
        """Let the printer work; give what the cable leaves of its words, or let time pass.

        Raises
        ------
        PortLost
        """
        until = self.clock.now() + timeout
        self.printer.settle()
        said = self.printer.take_output()
        if said:
            self.clock.move_to(self.printer.pace.host_time(self.printer.now))
            self.line.up(said, self.clock.now())
        self._check()
        at = self.line.next_s
        if at <= max(until, self.clock.now()):
            self.clock.move_to(at)
            return self.line.due(at)
        self.clock.move_to(until)
        self._run_printer()
        return b""

    def _run_printer(self) -> None:
        """Let the printer live up to now, by its own pace."""
        self.printer.run_to(self.printer.pace.board_time(self.clock.now()))

    def _check(self) -> None:
        if self.printer.unplugged:
            raise PortLost("the simulated cable was pulled")

    def reset(self) -> bool:
        """Pull the board's reset line."""
        self.printer.reset()
        return True

    def close(self) -> None:
        """Do nothing: there is nothing to let go of."""
