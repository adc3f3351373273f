"""A printer between prints: kept in touch with, asked, and moved by hand.

One thread runs all of it. `halt_motion` and `kill` may be called by others.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from design.toolpath.gcode.dialect import dialect_of
from firmware_profiles.families.position_reply import parse_position
from printctl.link.channel import Wiring
from printctl.link.errors import LinkError
from printctl.link.families import family_of
from printctl.link.placing import RETRIES
from printctl.link.retreat import heaters_off
from printctl.link.states import LinkState
from printctl.station.listening import Listening
from printctl.station.status import Place, Temperature
from printctl.station.temperatures import parse_temperatures

POLL_S: Final = 1.0
"""Interval of temperatures."""
SIGN_S: Final = 20.0
"""Interval at which the firmware's own switch-off time begins anew."""
PIECE_S: Final = 0.15
"""A move is sent in pieces of so long, so that it can be ended between two of them."""
AHEAD_S: Final = 0.5
"""So much of it the printer is given ahead; it is what still runs after `halt_motion`."""
_WITHIN_MM: Final = 0.011
"""Of the two decimals that M114 tells."""


class Standby(Listening):
    """One printer without a job; see `Listening` for what it hears.

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
    position : (x, y, z) or None, mm
    plunger : float or None, mm
        E as the printer counts it.
    temperatures : tuple of Temperature
    """

    def __init__(self, wiring: Wiring, pace: float, changed: Callable[[], None]) -> None:
        super().__init__(wiring)
        self._pace, self._changed = pace, changed
        self._dialect = dialect_of(wiring.printer)
        self._poll_due = self._sign_due = 0.0
        self.position: Place | None = None
        self.plunger: float | None = None
        self.temperatures: tuple[Temperature, ...] = ()

    @property
    def readings(self) -> tuple[str, ...]:
        """Last readings of what the profile has watched."""
        return tuple(str(gauge) for gauge in self._gauges)

    # --- begin and end -----------------------------------------------------------------------

    def begin(self) -> None:
        """Find the printer, check it, and see where it stands.

        Raises
        ------
        Over, LinkError
            As any print's beginning.
        """
        self._state = LinkState.CONNECTING
        self._connect()
        self._state = LinkState.CHECKING
        self._check()
        self._agree(self.protocol.renumber)
        self.protocol.load([], 0, 0)
        self._state, self._begun = LinkState.PAUSED, True
        if family_of(self.wiring.printer).m84_sets_timeout:
            self._command(b"M84 S0")  # else the motors lose their power, and the place its meaning
        self._sign_of_life()
        self._poll()

    def end(self) -> None:
        """Take no further part: what another thread wishes of this one is over."""
        self._ended.set()

    def let_go(self) -> list[str]:
        """Leave the printer to itself, heaters off; give the names of those that stay on.

        The motors stay powered, so that nothing sinks. The firmware's own switch-off time is taken
        back, but not where something stays on: then it must strike.
        """
        self.do(*(command.decode("ascii") for command in heaters_off(self.wiring.printer)))
        self._poll()
        on = [one.name for one in self.temperatures if one.target_c]
        if not on and self._dialect.idle_timeout and self._dialect.zero_is_off:
            self.do(self._dialect.idle_timeout.format(seconds="0"))
        return on

    def halt_motion(self) -> None:
        """End the move that goes on, soon; from any thread. The position stays known."""
        self._halt.set()

    def allow_motion(self) -> None:
        """Take back `halt_motion`, before a move is asked for."""
        self._halt.clear()

    # --- waiting -------------------------------------------------------------------------------

    def rest(self, seconds: float) -> None:
        """Hear the printer for so long, and ask it what is due."""
        self._pump(self.wiring.clock.now() + seconds)
        self._attend()

    def _attend(self) -> None:
        now = self.wiring.clock.now()
        if self._killed.is_set():
            self._await_halt()
        if now >= self._sign_due:
            self._sign_of_life()
        if now >= self._poll_due:
            self._poll()

    def _poll(self) -> None:
        now = self.wiring.clock.now()
        self._poll_due = now + POLL_S
        found = parse_temperatures(self._command(b"M105", journalled=False))
        self.temperatures = found or self.temperatures
        self.look()  # somebody may turn the knob on the machine
        high = self._too_high(now)
        if high and high != self.trouble:
            self._alarm(high)
        self.trouble = high or self._taken_fault()
        self._changed()

    def _sign_of_life(self) -> None:
        printer = self.wiring.printer
        self._sign_due = self.wiring.clock.now() + SIGN_S
        if self._dialect.idle_timeout and printer.idle_timeout_s > 0:
            seconds = f"{printer.idle_timeout_s:.0f}"
            command = self._dialect.idle_timeout.format(seconds=seconds)
            self._command(command.encode("ascii"), journalled=False)

    # --- doing ---------------------------------------------------------------------------------

    def do(self, *commands: str) -> list[str]:
        """Send commands one after the other; give what the printer says to all of them.

        Raises
        ------
        LinkError
            When the printer complains.
        """
        heard: list[str] = []
        for command in commands:
            for line in self._command(command.encode("ascii")):
                heard.append(line.decode("ascii", "backslashreplace"))
            self._raise_fault(command)
        return heard

    def travel(self, target: Place, speed_mm_s: float) -> bool:
        """Move the tip in a straight line and wait until it is there.

        Returns
        -------
        bool
            Whether it went all the way; else `halt_motion` ended it.

        Raises
        ------
        LinkError
            When the printer complains or went elsewhere.
        """
        start = self.position
        if start is None:
            raise LinkError("the printer doesn't tell its position (M114); reconnect")
        steps = self._steps({a: b - c for a, b, c in zip("xyz", target, start, strict=True)})
        count = self._pieces(math.dist(start, target) / speed_mm_s, steps)
        feed = f"F{speed_mm_s * 60:.3f}"

        def piece(part: float) -> str:
            at = [a + (b - a) * part for a, b in zip(start, target, strict=True)]
            words = [
                f"{letter}{value:.4f}"
                for letter, value, a, b in zip("XYZ", at, start, target, strict=True)
                if a != b
            ]
            return " ".join(["G1", *words, feed])

        done = self._piecewise(piece, count, math.dist(start, target) / speed_mm_s)
        end = [a + (b - a) * done for a, b in zip(start, target, strict=True)]
        self._expect((end[0], end[1], end[2]))
        return done == 1.0

    def push(self, mm: float, speed_mm_s: float) -> float:
        """Move the plunger by ``mm`` and wait; give how far it was sent. see `plunger`.

        Raises
        ------
        LinkError
            When the printer complains, doesn't say where the plunger is, or a reading is too high.
        """
        begin = self.plunger
        if begin is None:
            raise LinkError("the printer doesn't tell where the plunger is (M114); reconnect")
        if self._dialect.cold_extrusion:
            self.do(self._dialect.cold_extrusion)
        seconds = abs(mm) / speed_mm_s
        feed = f"F{speed_mm_s * 60:.3f}"

        def piece(part: float) -> str:
            return f"G1 E{begin + mm * part:.5f} {feed}"

        try:
            count = self._pieces(seconds, self._steps({"e": mm}))
            done = self._piecewise(piece, count, seconds, watched=mm > 0)
            self.plunger = begin + mm * done
        finally:
            self.look()
        return mm * done

    def ask_soon(self) -> None:
        """Have temperatures asked for at the next opportunity."""
        self._poll_due = 0.0

    def look(self) -> None:
        """Ask where the printer is."""
        for _ in range(RETRIES):
            found = parse_position(self._command(b"M114", journalled=False))
            if {"X", "Y", "Z"} <= set(found):
                self._take((found["X"], found["Y"], found["Z"]), found.get("E"))
                return
        self.position = self.plunger = None

    def _take(self, place: Place, e: float | None) -> None:
        """Believe what M114 says, but for what its two decimals leave out of a known place."""
        was, pushed = self.position, self.plunger
        if was is None or any(abs(a - b) > _WITHIN_MM for a, b in zip(was, place, strict=True)):
            self.position = place
        if pushed is None or e is None or abs(pushed - e) > _WITHIN_MM:
            self.plunger = e

    # --- steps ---------------------------------------------------------------------------------

    def _piecewise(
        self, piece: Callable[[float], str], count: int, seconds: float, watched: bool = False
    ) -> float:
        """Send a move in pieces, a little ahead of the printer; give how much of it was sent.

        One that is ``watched`` ends where a force or pressure is above its limit.
        """
        begun, sent = self.wiring.clock.now(), 0
        try:
            while sent < count and not self._halt.is_set() and not (watched and self.trouble):
                sent += 1
                self.do(piece(sent / count))
                self._keep_pace(begun, seconds * sent / count)
        finally:
            self._command(b"M400")
        self._raise_fault("the move")
        return sent / count

    def _steps(self, by_mm: dict[str, float]) -> float:
        """Steps of the axis that makes the most of them."""
        per_mm = self.wiring.printer.steps_per_mm
        return max(abs(mm) * getattr(per_mm, axis) for axis, mm in by_mm.items())

    def _pieces(self, seconds: float, steps: float) -> int:
        """In how many pieces a move is sent; a firmware drops one of few steps (Marlin: 6)."""
        fewest = 2 * self.wiring.printer.min_steps_per_segment
        return max(1, min(math.ceil(seconds / PIECE_S), int(steps // fewest)))

    def _keep_pace(self, begun: float, seconds: float) -> None:
        """Wait until only `AHEAD_S` of what was sent are ahead; ask meanwhile what is due."""
        clock = self.wiring.clock
        due = begun + (seconds / self._pace if self._pace else 0.0) - AHEAD_S
        self._attend()
        while clock.now() < due and not self._halt.is_set():
            self._pump(min(due, clock.now() + 0.05))
            self._attend()

    def _expect(self, place: Place) -> None:
        """See that the printer went where it was sent; go on counting from there exactly."""
        self.position = place
        self.look()
        at = self.position
        if at is None or math.dist(at, place) > 2 * _WITHIN_MM:
            raise LinkError(
                f"the printer stands at {_told(at)} and not at {_told(place)}: its own limits "
                "(soft endstops) or a wrong position keep it from there"
            )

    def _raise_fault(self, what: str) -> None:
        text = self._taken_fault()
        if text:
            raise LinkError(f"{text} (asked for: {what})")


def _told(place: Place | None) -> str:
    if place is None:
        return "a place it doesn't tell"
    return " ".join(f"{axis}{mm:.2f}" for axis, mm in zip("XYZ", place, strict=True))
