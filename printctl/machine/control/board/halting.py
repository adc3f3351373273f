"""Emergency halt of the firmware, written to the port at once by any thread.

Marlin's ``kill`` (M112, thermal runaway) leaves its step interrupts on for 0.6 s, so that its
words get out: what the planner holds goes on being made. The wait is counted in the processor's
own time, of which each step event takes 47.5 µs. Measured on bugfix-2.1.x (ATmega2560): 0.64 s at
566 steps/s, 0.72 at 2825, 0.84 at 5634, 1.27 at 10,680. With the emergency parser M410 stops the
motors within a millisecond; moves are then dropped for 1 s, in which M112 isn't looked at. A line
that was waiting for the planner is let in after that second, and its first step comes 0.1 s later:
a second M410, sent meanwhile, drops it before. It may be used up by the first: where M410 arrives
as the board reads a line and its planner is full, its handler runs twice in a row, and one kill in
fifteen was followed by a move of 1.6 mm of the plunger. So one M410 more, a second later, and one
more again for each further line in flight, which is let in a second after the one before it; then
M112: no step after the first. Heaters go off with M112.

Valves are told to shut before M112, where there are any; whether that is done before it is the
firmware's matter.

Without emergency parser a line is looked at where the command queue has room, M410 as well as
M112, but its second would hold M112 up, with heaters on and moves let in: M112 alone.

A board that stood still meanwhile finds all of these at once, and looks at M112 first
(`Temperature::task`, bugfix-2.1.x): only one that said something in between has obeyed M410.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final, NoReturn

from firmware_profiles import Printer
from printctl.machine.control.board.steps import Steps, Wait
from printctl.machine.control.board.wiring import Wiring
from printctl.machine.errors import PortLost
from printctl.machine.families import link_facts
from printctl.machine.job.dispensing import shut_valves
from printctl.machine.job.moves import MotorRunOn, unknown_run_on
from printctl.machine.records.states import LinkState, PrintEnded

KILL_AGAIN_S: Final = 0.02
"""A line that was cut short or lacks its end is refused, and the first M112 behind it dropped."""
KILL_REPEAT_S: Final = 0.2
KILL_ATTEMPTS: Final = 10
KILL_WAIT_S: Final = 4.0
WIRE_S: Final = 0.1
_NO_CONTROLS: Final = dict.fromkeys(range(32), " ")
UNCONFIRMED: Final = "the printer has NOT confirmed: cut its power"
HALTED_BEFORE: Final = "emergency stop by the user; the firmware had halted itself before"


@dataclass(frozen=True)
class Halting:
    """What is written to halt a firmware, and what its motors do."""

    first: tuple[tuple[bytes, float], ...]  # written before, and the wait behind each, s
    last: bytes  # written again and again until the printer has halted
    stops_at_once: bool = False  # the motors stand when the first has arrived
    # how long motors that don't stand, or whose firmware halts itself, may go on, at the machine's
    # greatest speed
    runs_on_s: float = 0.0

    def words(self, run_on: MotorRunOn | None, stopped: bool) -> str:
        """Say what the motors did, or may have done.

        ``run_on``: how far they may have run on, None for unknown; ``stopped``: whether the
        printer lived between ``first`` and ``last``.
        """
        if self.stops_at_once and stopped:
            return "its motors stopped at M410 at the latest"
        if not self.runs_on_s:
            return "what its motors did meanwhile is unknown"
        seconds = self.runs_on_s if run_on is None else run_on.seconds
        far = "" if run_on is None else f" ({run_on.path_mm:.1f} mm)"
        return (
            f"its motors may have run on for up to {math.ceil(seconds * 100) / 100:.2f} s after "
            f"that{far}: check where the needle is"
        )


def halting_of(printer: Printer, kill: bytes, emergency_parser: bool) -> Halting:
    """Return the fastest safe way to halt a printer's firmware, at the end by ``kill``.

    ``emergency_parser``: whether it looks at M410 and M112 at once: what it says of itself, else
    its profile.
    """
    quickstop = link_facts(printer).quickstop
    valves = b"\n".join((b"", *shut_valves(printer), b""))
    shuts = ((valves, 0.0),) if printer.airs else ()
    if not quickstop or not emergency_parser:
        return Halting(shuts, kill, runs_on_s=unknown_run_on(printer))
    at_once = b"\n%b\n" % quickstop
    first = ((at_once, 0.5), *shuts, *((at_once, 1.0),) * printer.lines_in_flight, (at_once, 1.3))
    return Halting(first, kill, True, unknown_run_on(printer))


class Kill:
    """Emergency halt of one printer.

    ``asked`` is set once a halt was requested: nothing else is sent from then on, and the transport
    itself lets nothing else out behind the first byte of the halt. ``awaiting`` is
    called then, by the thread that speaks to the printer, before it waits for the printer's
    confirmation. ``halted_itself``: the firmware had halted itself before a halt was requested.
    ``pulled_reset``: `strike` came to the reset line.
    """

    def __init__(self, wiring: Wiring, awaiting: Callable[[], None] = lambda: None) -> None:
        self._wiring, self._awaiting = wiring, awaiting
        self.asked: Final = threading.Event()
        self._halted, self._ended = threading.Event(), threading.Event()
        self._parser = wiring.printer.emergency_parser
        self._asked_s = self._left = 0.0
        self._left_s: dict[str, float] = {}
        self._sent = self._alive = self.halted_itself = self.pulled_reset = False

    @property
    def halting(self) -> Halting:
        """How the firmware is halted: by what it says of itself (M115), else by its profile."""
        wiring = self._wiring
        return halting_of(wiring.printer, wiring.protocol.kill_bytes, self._parser)

    def learn(self, capabilities: dict[str, bool]) -> None:
        """Take what the firmware says of its emergency parser (M115)."""
        profile = self._wiring.printer.emergency_parser
        self._parser = capabilities.get("EMERGENCY_PARSER", profile)

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
        self._sent = self.pulled_reset = True
        wiring.transport.reset()

    def _write(self, data: bytes) -> bool:
        """Write at once; note when each command left first. Return whether the port took it."""
        clock, what = self._wiring.clock, data.decode("ascii").translate(_NO_CONTROLS)
        what = " ".join(what.split())
        first = what not in self._left_s
        if first:  # before it is written: the answer may come before the next line is reached
            self._left_s[what] = clock.now()
        try:
            self._wiring.transport.write_halt(data)
        except PortLost:  # it may be full: the wire's end is found elsewhere
            if first:
                del self._left_s[what]
            return False
        if first:
            self._left_s[what] = clock.now()
        return True

    def end(self) -> None:
        """Record that no thread speaks to the printer any more: a later `strike` is no use."""
        self._ended.set()

    # --- for the thread that speaks to the printer -----------------------------------------------

    def halted(self) -> None:
        """Record that the printer says that it has halted."""
        self.halted_itself |= not (self.asked.is_set() or self._halted.is_set())
        self._halted.set()

    def heard(self) -> None:
        """Record that the printer says something, after `strike`.

        What it said before may still be on the wire for `WIRE_S`.
        """
        late = self._wiring.exchange.now_s - self._left > WIRE_S
        self._alive |= late and not self._sent

    def words(self, run_on: MotorRunOn | None) -> str:
        """Return what was sent and how soon it worked, once the printer has halted."""
        asked, left = self._asked_s, dict(self._left_s)
        each = [
            f"{what} left the host after {(at - asked) * 1e3:.1f} ms" for what, at in left.items()
        ]
        sent = ", ".join(each) or "nothing was sent"
        printer_s = self._wiring.exchange.now_s - max(left.values(), default=asked)
        return (
            f"emergency stop by the user; {sent}, the printer confirmed the halt "
            f"{printer_s * 1e3:.0f} ms later; {self.halting.words(run_on, self._alive)}"
        )

    def await_halt(self, hear: Callable[[bytes, float], None]) -> Steps[NoReturn]:
        """Wait for the printer to say that it has halted; send nothing more; end the print.

        ``hear`` handles what the printer says, and when.
        """
        exchange = self._wiring.exchange
        exchange.drop_bytes()
        exchange.tell(self._awaiting)
        limit = exchange.now_s + KILL_WAIT_S
        while exchange.now_s < limit or not self._sent:
            if not self._sent:
                limit = exchange.now_s + KILL_WAIT_S
            if self.halted_itself and (question := self._wiring.protocol.take_output()):
                ask = partial(self._wiring.transport.write_halt, question)
                exchange.effects.append(ask)  # why: nothing else is left
            try:
                now, data = yield Wait(math.inf)
            except PortLost:
                break
            if data:
                self.heard()
                hear(data, now)
        # halted without a reason
        why = HALTED_BEFORE if self.halted_itself else f"emergency stop by the user; {UNCONFIRMED}"
        raise PrintEnded(LinkState.KILLED, why, known=False)
