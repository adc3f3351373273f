"""Track the tip and plunger of an idle printer, from its replies and the commands sent."""

from __future__ import annotations

import math
from typing import Final

from firmware_profiles.families.position_reply import parse_position
from printctl.machine.control.channel import Channel
from printctl.machine.control.firmware import RETRIES
from printctl.machine.control.station_status import Place
from printctl.machine.errors import LinkError

_WITHIN_MM: Final = 0.011
"""Of the two decimals that M114 tells."""


class Tip:
    """Asked of the printer, or known more exactly from what it was sent.

    Parameters
    ----------
    channel : Channel

    Attributes
    ----------
    position : (x, y, z) or None, mm
    plunger : float or None, mm
        E as the printer counts it.
    """

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self.position: Place | None = None
        self.plunger: float | None = None

    def look(self) -> None:
        """Ask where the printer is."""
        for _ in range(RETRIES):
            position = parse_position(self._channel.ask(b"M114"))
            if {"X", "Y", "Z"} <= set(position):
                self._believe((position["X"], position["Y"], position["Z"]), position.get("E"))
                return
        self.position = self.plunger = None

    def _believe(self, place: Place, e: float | None) -> None:
        """Take what M114 says, but for what its two decimals leave out of a known place."""
        was, pushed = self.position, self.plunger
        if was is None or any(abs(a - b) > _WITHIN_MM for a, b in zip(was, place, strict=True)):
            self.position = place
        if pushed is None or e is None or abs(pushed - e) > _WITHIN_MM:
            self.plunger = e

    def expect(self, place: Place) -> None:
        """See that the printer went where it was sent; go on counting from there exactly.

        Raises
        ------
        LinkError
            When it went elsewhere.
        """
        self.position = place
        self.look()
        at = self.position
        if at is None or math.dist(at, place) > 2 * _WITHIN_MM:
            raise LinkError(
                f"the printer stands at {_words(at)} and not at {_words(place)}: its own limits "
                "(soft endstops) or a wrong position keep it from there"
            )

    def push_to(self, mm: float) -> None:
        """Take notice of where the plunger was sent."""
        self.plunger = mm


def _words(place: Place | None) -> str:
    if place is None:
        return "a place it doesn't tell"
    return " ".join(f"{axis}{mm:.2f}" for axis, mm in zip("XYZ", place, strict=True))
