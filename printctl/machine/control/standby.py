"""Standby: keep in contact with an idle printer, query it, move it manually.

One thread runs all of it. `halt_motion` and `kill` may be called by others.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Final

from firmware_profiles.families import family_of
from printctl.machine.control.channel import Channel
from printctl.machine.control.connecting import connect
from printctl.machine.control.firmware import Firmware, FirmwareCheck
from printctl.machine.control.gauges import Gauge, read_high
from printctl.machine.control.halting import Kill
from printctl.machine.control.heat import Temperature, parse_temperatures
from printctl.machine.control.logbook import Logbook
from printctl.machine.control.manual_motion import Mover, send
from printctl.machine.control.progress import JobProgress
from printctl.machine.control.standby_events import StandbyEvents
from printctl.machine.control.station_status import Place
from printctl.machine.control.tip import Tip
from printctl.machine.control.wiring import Wiring
from printctl.machine.families import link_facts
from printctl.machine.job.job import Job
from printctl.machine.job.retreat import heaters_off
from printctl.machine.records.states import LinkState

POLL_S: Final = 1.0
"""Interval of temperatures."""
SIGN_S: Final = 20.0
"""Interval at which the firmware's own switch-off time begins anew."""
_UNRECORDED: Final = frozenset({"reading"})
"""Once a second for days."""


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
    temperatures : tuple of Temperature
    """

    def __init__(self, wiring: Wiring, pace: float, changed: Callable[[], None]) -> None:
        self._wiring, self._changed = wiring, changed
        self._dialect = family_of(wiring.printer).dialect(wiring.printer)
        self._logbook = Logbook(
            wiring, JobProgress(wiring, Job([], [], "", "no job")), unrecorded=_UNRECORDED
        )
        self._kill, self._halt = Kill(wiring, changed), threading.Event()
        self._channel = Channel(wiring, self._logbook, self._kill)
        self._channel.handler = self._events = StandbyEvents(self._channel, self._halt)
        self._gauges = [Gauge(one) for one in wiring.printer.watch]
        self._firmware = FirmwareCheck(self._channel)
        self._tip = Tip(self._channel)
        self._motion = Mover(self._channel, self._tip, self._events, self._halt, pace, self._attend)
        self._poll_due = self._sign_due = 0.0
        self.temperatures: tuple[Temperature, ...] = ()

    # --- as it stands ----------------------------------------------------------------------------

    @property
    def position(self) -> Place | None:
        """Where the tip is, (x, y, z), mm; None where the printer doesn't tell."""
        return self._tip.position

    @property
    def plunger(self) -> float | None:
        """E as the printer counts it, mm; None where it doesn't tell."""
        return self._tip.plunger

    @property
    def trouble(self) -> str:
        """What was read above its limit last, or what the printer complained of unasked."""
        return self._events.trouble

    @property
    def firmware(self) -> Firmware:
        """What the firmware says of itself."""
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

    def begin(self) -> None:
        """Find the printer, check it, and see where it stands.

        Raises
        ------
        PrintEnded, LinkError
            As any print's beginning.
        """
        protocol = self._wiring.protocol
        self._logbook.state = LinkState.CONNECTING
        connect(self._channel)
        self._logbook.state = LinkState.CHECKING
        self._firmware.check(self._gauges)
        self._channel.agree(protocol.renumber)
        protocol.load([], 0, 0)
        self._logbook.state = LinkState.PAUSED
        self._events.found = True
        if link_facts(self._wiring.printer).m84_sets_timeout:
            # else the motors lose their power, and the place its meaning
            self._channel.command(b"M84 S0")
        self._sign_of_life()
        self._poll()

    def end(self) -> None:
        """Take no further part: what another thread asks of this one is over."""
        self._kill.end()

    def let_go(self) -> list[str]:
        """Leave the printer to itself, heaters off; return the names of those that stay on.

        The motors stay powered, so that nothing sinks. The firmware's own switch-off time is taken
        back, but not where something stays on: then it must strike.
        """
        self.do(*(command.decode("ascii") for command in heaters_off(self._wiring.printer)))
        self._poll()
        on = [one.name for one in self.temperatures if one.target_c]
        if not on and self._dialect.idle_timeout and self._dialect.zero_is_off:
            self.do(self._dialect.idle_timeout.format(seconds="0"))
        return on

    # --- for any thread --------------------------------------------------------------------------

    def kill(self) -> None:
        """Halt the firmware at once; see `Kill.strike`."""
        self._kill.strike()

    def halt_motion(self) -> None:
        """End the move that goes on, soon; from any thread. The position stays known."""
        self._halt.set()

    def allow_motion(self) -> None:
        """Take back `halt_motion`, before a move is asked for."""
        self._halt.clear()

    # --- waiting ---------------------------------------------------------------------------------

    def rest(self, seconds: float) -> None:
        """Hear the printer for so long, and ask it what is due."""
        self._channel.pump(self._wiring.clock.now() + seconds)
        self._attend()

    def ask_soon(self) -> None:
        """Have temperatures asked for at the next opportunity."""
        self._poll_due = 0.0

    def _attend(self) -> None:
        now = self._wiring.clock.now()
        if self._kill.asked.is_set():
            self._channel.await_halt()
        if now >= self._sign_due:
            self._sign_of_life()
        if now >= self._poll_due:
            self._poll()

    def _poll(self) -> None:
        now = self._wiring.clock.now()
        self._poll_due = now + POLL_S
        self.temperatures = parse_temperatures(self._channel.ask(b"M105")) or self.temperatures
        self.look()  # somebody may turn the knob on the machine
        high = read_high(self._channel, self._gauges, now)
        if high and high != self.trouble:
            self._logbook.alarm(high)
        self._events.trouble = high or self._logbook.take_fault()
        self._changed()

    def _sign_of_life(self) -> None:
        printer = self._wiring.printer
        self._sign_due = self._wiring.clock.now() + SIGN_S
        if self._dialect.idle_timeout and printer.idle_timeout_s > 0:
            seconds = f"{printer.idle_timeout_s:.0f}"
            self._channel.ask(self._dialect.idle_timeout.format(seconds=seconds).encode("ascii"))

    # --- doing -----------------------------------------------------------------------------------

    def do(self, *commands: str) -> list[str]:
        """Send commands one after the other; return what the printer says to all of them.

        Raises
        ------
        LinkError
            When the printer complains.
        """
        return send(self._channel, *commands)

    def travel(self, target: Place, speed_mm_s: float) -> bool:
        """Move the tip in a straight line and wait; see `Motion.travel`."""
        return self._motion.travel(target, speed_mm_s)

    def push(self, mm: float, speed_mm_s: float) -> float:
        """Move the plunger and wait; see `Motion.push`."""
        return self._motion.push(mm, speed_mm_s)

    def look(self) -> None:
        """Ask where the printer is."""
        self._tip.look()
