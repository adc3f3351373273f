"""Emergency halt of the firmware, written to the port at once by any thread."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Final

from printctl.machine.control.halting import Halting, halting_of
from printctl.machine.control.wiring import Wiring
from printctl.machine.errors import PortLost
from printctl.machine.job.firmware import Firmware
from printctl.machine.job.moves import MotorRunOn
from printctl.machine.records.states import LinkState, PrintEnded

KILL_AGAIN_S: Final = 0.02
"""A line that was cut short or lacks its end is refused, and the first M112 behind it dropped."""
KILL_REPEAT_S: Final = 0.2
KILL_ATTEMPTS: Final = 10
KILL_WAIT_S: Final = 4.0
WIRE_S: Final = 0.1
_NO_CONTROLS: Final = dict.fromkeys(range(32), " ")
UNCONFIRMED: Final = "the printer has NOT confirmed: cut its power"
HALTED_BEFORE: Final = "killed by the user; the firmware had halted itself before"


def _words(data: bytes) -> str:
    """Return the commands in what is written, without control characters."""
    return " ".join(data.decode("ascii").translate(_NO_CONTROLS).split())


class Kill:
    """Emergency halt of one printer.

    Parameters
    ----------
    wiring : Wiring
    awaiting : callable, optional
        Called once a halt was asked for, by the thread that speaks to the printer, before it waits
        for the printer's confirmation.

    Attributes
    ----------
    asked : threading.Event
        Set once somebody has asked for it; nothing else is sent from then on.
    """

    def __init__(self, wiring: Wiring, awaiting: Callable[[], None] = lambda: None) -> None:
        self._awaiting = awaiting
        self.asked: Final = threading.Event()
        self._wiring = wiring
        self._parser = wiring.printer.emergency_parser
        self._asked_s = self._left = 0.0
        self._left_s: dict[str, float] = {}
        self._sent = self._alive = self._itself = False
        self._halted = threading.Event()
        self._ended = threading.Event()

    @property
    def halting(self) -> Halting:
        """How the firmware is halted: by what it says of itself (M115), else by its profile."""
        wiring = self._wiring
        return halting_of(wiring.printer, wiring.protocol.kill_bytes, self._parser)

    def learn(self, firmware: Firmware) -> None:
        """Take notice of what the firmware says of its emergency parser."""
        profile = self._wiring.printer.emergency_parser
        self._parser = firmware.capabilities.get("EMERGENCY_PARSER", profile)

    # --- for any thread --------------------------------------------------------------------------

    def strike(self) -> None:
        """Halt the firmware at once, from any thread and any state.

        The family's `halting` goes to the wire before anything else is done. M112 is repeated
        until the printer says that it has halted; after `KILL_ATTEMPTS` the reset line is pulled.
        """
        if self._ended.is_set():
            return
        wiring = self._wiring
        self._left = wiring.clock.now()
        if not self.asked.is_set():
            self._asked_s = self._left
        self.asked.set()
        halting = self.halting
        halts = ((halting.last, KILL_AGAIN_S), *((halting.last, KILL_REPEAT_S),) * KILL_ATTEMPTS)
        for attempt, (data, wait_s) in enumerate((*halting.first, *halts)):
            self._sent |= self._write(data) and data == halting.last
            if attempt == 0:
                self._left = wiring.clock.now()
            if self._halted.wait(wait_s) or self._ended.is_set():
                return
        self._sent = True
        wiring.transport.reset()

    def _write(self, data: bytes) -> bool:
        """Write at once; note when each command left first. Return whether the port took it."""
        wiring, what = self._wiring, _words(data)
        first = what not in self._left_s
        if first:  # before it is written: the answer may come before the next line is reached
            self._left_s[what] = wiring.clock.now()
        try:
            wiring.transport.write_urgent(data)
        except PortLost:  # it may be full: the wire's end is found elsewhere
            if first:
                del self._left_s[what]
            return False
        if first:
            self._left_s[what] = wiring.clock.now()
        return True

    def end(self) -> None:
        """Take notice that nobody speaks to the printer any more: a later `strike` is no use."""
        self._ended.set()

    # --- for the thread that speaks to the printer -----------------------------------------------

    def halted(self) -> None:
        """Take notice that the printer says that it has halted."""
        self._itself |= not (self.asked.is_set() or self._halted.is_set())
        self._halted.set()

    @property
    def halted_itself(self) -> bool:
        """Whether the firmware had halted itself before anybody asked for it."""
        return self._itself

    def heard(self) -> None:
        """Take notice that the printer says something, after `strike`.

        What it said before may still be on the wire for `WIRE_S`.
        """
        late = self._wiring.clock.now() - self._left > WIRE_S
        self._alive |= late and not self._sent

    def words(self, run_on: MotorRunOn | None) -> str:
        """Return what was sent and how soon it worked, once the printer has halted."""
        asked, left = self._asked_s, dict(self._left_s)
        each = [
            f"{what} left the host after {(at - asked) * 1e3:.1f} ms" for what, at in left.items()
        ]
        sent = ", ".join(each) or "nothing left the host"
        printer_s = self._wiring.clock.now() - max(left.values(), default=asked)
        return (
            f"killed by the user; {sent}, the printer said {printer_s * 1e3:.0f} ms "
            f"later that it has halted; {self.halting.told(run_on, self._alive)}"
        )

    def await_halt(self, hear: Callable[[], None]) -> None:
        """Wait for the printer to say that it has halted; send nothing more.

        Parameters
        ----------
        hear : callable
            Reads what the printer says, waiting for it, and handles it.

        Raises
        ------
        PrintEnded
        """
        self._awaiting()
        clock = self._wiring.clock
        limit = clock.now() + KILL_WAIT_S
        while clock.now() < limit or not self._sent:
            if not self._sent:
                limit = clock.now() + KILL_WAIT_S
            try:
                hear()
            except PortLost:
                break
        if self._halted.is_set():  # it didn't say why
            raise PrintEnded(LinkState.KILLED, HALTED_BEFORE, known=False)
        raise PrintEnded(
            LinkState.KILLED,
            f"killed by the user; {UNCONFIRMED}",
            known=False,
        )
