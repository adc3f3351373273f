"""Standby: keep in contact with an idle printer, query it, count where its tip stands.

One thread runs all of it. `halt_motion` and `kill` may be called by others.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Final, TypeVar

from firmware_profiles.families import family_of
from firmware_profiles.families.position_reply import parse_position
from printctl.machine.control.board.channel import Channel
from printctl.machine.control.board.connecting import connect
from printctl.machine.control.board.gauges import Gauge, read_high
from printctl.machine.control.board.halting import Kill
from printctl.machine.control.board.heat import Temperature, parse_temperatures
from printctl.machine.control.board.logbook import Logbook
from printctl.machine.control.board.progress import JobProgress
from printctl.machine.control.board.shell import drive
from printctl.machine.control.board.steps import Steps
from printctl.machine.control.board.wiring import Wiring
from printctl.machine.control.idle.standby_events import StandbyEvents
from printctl.machine.control.idle.station_status import Place
from printctl.machine.control.position.firmware import RETRIES, Firmware, FirmwareCheck
from printctl.machine.errors import LinkError
from printctl.machine.families import link_facts
from printctl.machine.job.job import Job
from printctl.machine.job.retreat import heaters_off
from printctl.machine.records.states import LinkState

T = TypeVar("T")

POLL_S: Final = 1.0
"""Interval of temperatures."""
SIGN_S: Final = 20.0
"""Interval at which the firmware's own switch-off time begins anew."""
_UNRECORDED: Final = frozenset({"reading"})
"""Once a second for days."""
_WITHIN_MM: Final = 0.011
"""Of the two decimals that M114 reports."""


class ElsewhereError(LinkError):
    """A move ended where it wasn't to lead: the printer's count can't be trusted."""


class Standby:
    """Idle printer in contact with the station.

    Parameters
    ----------
    wiring : Wiring
    pace : float
        Times real time that the printer lives at: 1, or a simulated printer's speed; 0 for as fast
        as it can.
    changed : callable
        Called when there is something new to tell.

    Attributes
    ----------
    channel : Channel
    halt : threading.Event
        Set to end the move that goes on.
    position : (x, y, z) or None, mm
        Where the tip is, asked of the printer, or known more exactly from what it was sent; None
        where the printer doesn't report it.
    plunger : float or None, mm
        E as the printer counts it.
    temperatures : tuple of Temperature
    """

    def __init__(self, wiring: Wiring, pace: float, changed: Callable[[], None]) -> None:
        self._wiring, self.pace, self._changed = wiring, pace, changed
        self.dialect = family_of(wiring.printer).dialect(wiring.printer)
        self._logbook = Logbook(
            wiring, JobProgress(wiring, Job([], [], "", "no job")), unrecorded=_UNRECORDED
        )
        self._kill, self.halt = Kill(wiring, changed), threading.Event()
        self.channel = Channel(wiring, self._logbook, self._kill)
        self.channel.handler = self._events = StandbyEvents(self.channel, self.halt)
        self._gauges = [Gauge(one) for one in wiring.printer.watch]
        self._firmware = FirmwareCheck(self.channel)
        self._poll_due = self._sign_due = 0.0
        self.position: Place | None = None
        self.plunger: float | None = None
        self.temperatures: tuple[Temperature, ...] = ()

    # --- as it stands ----------------------------------------------------------------------------

    @property
    def trouble(self) -> str:
        """What was read above its limit last, or what the printer complained of by itself."""
        return self._events.trouble

    @property
    def firmware(self) -> Firmware:
        """What the firmware reports of itself."""
        return self._firmware.firmware

    @property
    def readings(self) -> tuple[str, ...]:
        """Last readings of what the profile has watched."""
        return tuple(str(gauge) for gauge in self._gauges)

    @property
    def halt_asked(self) -> bool:
        """Whether a halt of the firmware was requested."""
        return self._kill.asked.is_set()

    # --- begin and end ---------------------------------------------------------------------------

    def begin(self) -> Steps[None]:
        """Find the printer, check it, and see where it stands; fails as any print's beginning."""
        protocol = self._wiring.protocol
        self._logbook.state = LinkState.CONNECTING
        yield from connect(self.channel)
        self._logbook.state = LinkState.CHECKING
        yield from self._firmware.check_keepalive(journalled=False)
        yield from self._firmware.check(self._gauges)
        yield from self.channel.agree(protocol.renumber)
        protocol.load([], 0, 0)
        self._logbook.state = LinkState.PAUSED
        self._events.found = True
        if link_facts(self._wiring.printer).m84_sets_timeout:
            # else the motors lose their power, and the place its meaning
            yield from self.channel.command(b"M84 S0")
        yield from self._sign_of_life()
        yield from self._poll()

    def end(self) -> None:
        """Take no further part: what another thread asks of this one is over."""
        self._kill.end()

    def let_go(self) -> Steps[list[str]]:
        """Leave the printer to itself, heaters off; return the names of those that stay on.

        The motors stay powered, so that nothing sinks. The firmware's own switch-off time is taken
        back, but not where something stays on: then it must strike.
        """
        off = heaters_off(self._wiring.printer)
        yield from self.do(*(command.decode("ascii") for command in off))
        yield from self._poll()
        on = [one.name for one in self.temperatures if one.target_c]
        if not on and self.dialect.idle_timeout and self.dialect.zero_is_off:
            yield from self.do(self.dialect.idle_timeout.format(seconds="0"))
        return on

    # --- for any thread --------------------------------------------------------------------------

    def kill(self) -> None:
        """Halt the firmware at once; see `Kill.strike`."""
        self._kill.strike()

    def halt_motion(self) -> None:
        """End the move that goes on, soon. The position stays known."""
        self.halt.set()

    def allow_motion(self) -> None:
        """Take back `halt_motion`, before a move is asked for."""
        self.halt.clear()

    # --- for the thread that speaks to the printer -----------------------------------------------

    def drive(self, steps: Steps[T]) -> T:
        """Carry out steps of this standby, or on it; return what they return."""
        return drive(steps, self._wiring)

    # --- waiting ---------------------------------------------------------------------------------

    def rest(self, seconds: float) -> Steps[None]:
        """Hear the printer for so long, and ask it what is due."""
        yield from self.channel.pump(self.channel.now + seconds)
        yield from self.attend()

    def ask_soon(self) -> None:
        """Have temperatures asked for at the next opportunity."""
        self._poll_due = 0.0

    def attend(self) -> Steps[None]:
        """Ask the printer what is due; raise PrintEnded where it was halted."""
        now = self.channel.now
        if self._kill.asked.is_set():
            yield from self.channel.await_halt()
        if now >= self._sign_due:
            yield from self._sign_of_life()
        if now >= self._poll_due:
            yield from self._poll()

    def _poll(self) -> Steps[None]:
        now = self.channel.now
        self._poll_due = now + POLL_S
        replies = yield from self.channel.ask(b"M105")
        self.temperatures = parse_temperatures(replies) or self.temperatures
        yield from self.look()  # somebody may turn the knob on the machine
        high = yield from read_high(self.channel, self._gauges, now)
        if high and high != self.trouble:
            self._logbook.alarm(high)
        self._events.trouble = high or self._logbook.take_fault()
        self._wiring.exchange.tell(self._changed)

    def _sign_of_life(self) -> Steps[None]:
        printer = self._wiring.printer
        self._sign_due = self.channel.now + SIGN_S
        if self.dialect.idle_timeout and printer.idle_timeout_s > 0:
            seconds = f"{printer.idle_timeout_s:.0f}"
            command = self.dialect.idle_timeout.format(seconds=seconds)
            yield from self.channel.ask(command.encode("ascii"))

    # --- doing -----------------------------------------------------------------------------------

    def do(self, *commands: str) -> Steps[list[str]]:
        """Send commands one after the other; return what the printer says to all of them.

        LinkError when it complains.
        """
        heard: list[str] = []
        for command in commands:
            for line in (yield from self.channel.command(command.encode("ascii"))):
                heard.append(line.decode("ascii", "backslashreplace"))
            self.raise_fault(command)
        return heard

    def raise_fault(self, what: str) -> None:
        """Raise `LinkError` where the printer complained of what it was asked for."""
        text = self._logbook.take_fault()
        if text:
            raise LinkError(f"{text} (requested: {what})")

    # --- where the tip stands --------------------------------------------------------------------

    def look(self) -> Steps[None]:
        """Ask where the printer is; keep what M114's two decimals leave out of a known place."""
        for _ in range(RETRIES):
            at = parse_position((yield from self.channel.ask(b"M114")))
            if not {"X", "Y", "Z"} <= set(at):
                continue
            place, e = (at["X"], at["Y"], at["Z"]), at.get("E")
            was, pushed = self.position, self.plunger
            if was is None or any(abs(a - b) > _WITHIN_MM for a, b in zip(was, place, strict=True)):
                self.position = place
            if pushed is None or e is None or abs(pushed - e) > _WITHIN_MM:
                self.plunger = e
            return
        self.position = self.plunger = None

    def expect(self, place: Place) -> Steps[None]:
        """Go on counting exactly from where the tip was sent.

        `ElsewhereError` when it went elsewhere.
        """
        self.position = place
        yield from self.look()
        at = self.position
        if at is None or math.dist(at, place) > 2 * _WITHIN_MM:
            raise ElsewhereError(
                f"the printer is at {_words(at)}, not at {_words(place)}: its own limits (soft "
                "endstops) or a wrong position prevent the move"
            )


def _words(place: Place | None) -> str:
    if place is None:
        return "an unreported position"
    return " ".join(f"{axis}{mm:.2f}" for axis, mm in zip("XYZ", place, strict=True))
