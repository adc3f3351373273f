"""Move tip or plunger of an idle printer by hand, in short pieces that can be interrupted."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from firmware_profiles.families import family_of
from printctl.machine.control.channel import Channel
from printctl.machine.control.standby_events import StandbyEvents
from printctl.machine.control.station_status import Place
from printctl.machine.control.tip import Tip
from printctl.machine.errors import LinkError

PIECE_S: Final = 0.15
"""Length of a piece."""
AHEAD_S: Final = 0.5
"""So much of a move the printer is given ahead; it is what still runs after it was ended."""


def send(channel: Channel, *commands: str) -> list[str]:
    """Send commands one after the other; return what the printer says to all of them.

    Raises
    ------
    LinkError
        When the printer complains.
    """
    heard: list[str] = []
    for command in commands:
        for line in channel.command(command.encode("ascii")):
            heard.append(line.decode("ascii", "backslashreplace"))
        raise_fault(channel, command)
    return heard


def raise_fault(channel: Channel, what: str) -> None:
    """Raise `LinkError` where the printer complained of what it was asked for."""
    text = channel.logbook.take_fault()
    if text:
        raise LinkError(f"{text} (asked for: {what})")


@dataclass(frozen=True)
class Mover:
    """Moves one printer manually.

    Attributes
    ----------
    channel : Channel
    tip : Tip
    events : StandbyEvents
        Tells of trouble that a push ends for.
    halt : threading.Event
        Set by any thread to end the move that goes on.
    pace : float
        Times real time that the printer lives at; 0 for as fast as it can.
    attend : callable
        Asks what is due meanwhile.
    """

    channel: Channel
    tip: Tip
    events: StandbyEvents
    halt: threading.Event
    pace: float
    attend: Callable[[], None]

    def travel(self, target: Place, speed_mm_s: float) -> bool:
        """Move the tip in a straight line and wait until it is there.

        Returns
        -------
        bool
            Whether it went all the way; else `halt` ended it.

        Raises
        ------
        LinkError
            When the printer complains or went elsewhere.
        """
        start = self.tip.position
        if start is None:
            raise LinkError("the printer doesn't tell its position (M114); reconnect")
        seconds = math.dist(start, target) / speed_mm_s
        steps = self._steps({a: b - c for a, b, c in zip("xyz", target, start, strict=True)})
        feed = f"F{speed_mm_s * 60:.3f}"

        def piece(part: float) -> str:
            words = [
                f"{letter}{value:.4f}"
                for letter, value, a, b in zip(
                    "XYZ", _between(start, target, part), start, target, strict=True
                )
                if a != b
            ]
            return " ".join(["G1", *words, feed])

        done = self._piecewise(piece, self._pieces(seconds, steps), seconds)
        self.tip.expect(_between(start, target, done))
        return done == 1.0

    def push(self, mm: float, speed_mm_s: float) -> float:
        """Move the plunger by ``mm`` and wait; return how far it was sent.

        Raises
        ------
        LinkError
            When the printer complains, doesn't say where the plunger is, or a reading is too high.
        """
        begin = self.tip.plunger
        if begin is None:
            raise LinkError("the printer doesn't tell where the plunger is (M114); reconnect")
        printer = self.channel.wiring.printer
        cold_extrusion = family_of(printer).dialect(printer).cold_extrusion
        if cold_extrusion:
            send(self.channel, cold_extrusion)
        seconds = abs(mm) / speed_mm_s
        feed = f"F{speed_mm_s * 60:.3f}"

        def piece(part: float) -> str:
            return f"G1 E{begin + mm * part:.5f} {feed}"

        try:
            count = self._pieces(seconds, self._steps({"e": mm}))
            done = self._piecewise(piece, count, seconds, watched=mm > 0)
            self.tip.push_to(begin + mm * done)
        finally:
            self.tip.look()
        return mm * done

    # --- pieces ----------------------------------------------------------------------------------

    def _piecewise(
        self, piece: Callable[[float], str], count: int, seconds: float, watched: bool = False
    ) -> float:
        """Send a move in pieces, a little ahead of the printer; return how much of it was sent.

        One that is ``watched`` ends where a force or pressure is above its limit.
        """
        begun, sent = self.channel.wiring.clock.now(), 0
        try:
            while sent < count and not self._ended(watched):
                sent += 1
                send(self.channel, piece(sent / count))
                self._keep_pace(begun, seconds * sent / count)
        finally:
            self.channel.command(b"M400")
        raise_fault(self.channel, "the move")
        return sent / count

    def _ended(self, watched: bool) -> bool:
        return self.halt.is_set() or (watched and bool(self.events.trouble))

    def _steps(self, by_mm: dict[str, float]) -> float:
        """Return the steps of the axis that makes the most of them."""
        per_mm = self.channel.wiring.printer.steps_per_mm
        return max(abs(mm) * getattr(per_mm, axis) for axis, mm in by_mm.items())

    def _pieces(self, seconds: float, steps: float) -> int:
        """Return the pieces of a move; a firmware drops one of few steps (Marlin: 6)."""
        fewest = 2 * self.channel.wiring.printer.min_steps_per_segment
        return max(1, min(math.ceil(seconds / PIECE_S), int(steps // fewest)))

    def _keep_pace(self, begun: float, seconds: float) -> None:
        """Wait until only `AHEAD_S` of what was sent are ahead; ask meanwhile what is due."""
        clock = self.channel.wiring.clock
        due = begun + (seconds / self.pace if self.pace else 0.0) - AHEAD_S
        self.attend()
        while clock.now() < due and not self.halt.is_set():
            self.channel.pump(min(due, clock.now() + 0.05))
            self.attend()


def _between(start: Sequence[float], end: Sequence[float], part: float) -> Place:
    x, y, z = (a + (b - a) * part for a, b in zip(start, end, strict=True))
    return x, y, z
