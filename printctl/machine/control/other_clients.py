"""Poll Klipper for other clients' changes: a shift ends the print; heaters and speed are reset."""

from __future__ import annotations

import math
from typing import Final

from printctl.checks.gate.firmware import blind_resets
from printctl.machine.control.channel import Channel
from printctl.machine.control.heat_check import HeatCheck
from printctl.machine.control.position_check import PositionCheck
from printctl.machine.families import link_facts

EVERY_S: Final = 1.0
"""Interval of comparisons: three lines and their answers, for which nothing stands still."""
_SPEED: Final = "M220"


class OtherClients:
    """Notices what another client of the printer has changed, by asking for it.

    Klipper answers each client alone: a G91, M221 or SET_GCODE_OFFSET of another one is told to
    nobody else. What it doesn't tell at all (the speed factor) is set anew.

    Parameters
    ----------
    channel : Channel
    position : PositionCheck
    heat : HeatCheck

    Attributes
    ----------
    next_due : float, s
        When they are compared next; infinite where other programs' lines are noticed by themselves.
    """

    def __init__(self, channel: Channel, position: PositionCheck, heat: HeatCheck) -> None:
        self._channel, self._position, self._heat = channel, position, heat
        self.next_due = math.inf

    @property
    def unseen(self) -> bool:
        """Whether what they do must be asked for."""
        return bool(link_facts(self._channel.wiring.printer).place_question)

    def begin(self, now: float) -> None:
        """Compare for the first time a while after ``now``."""
        if self.unseen:
            self.next_due = now + EVERY_S

    def look(self, now: float) -> None:
        """Compare where that is due.

        Raises
        ------
        PrintEnded
            Where the next lines would lead elsewhere, or push otherwise, than the job says.
        """
        if now < self.next_due:
            return
        self._channel.settle()
        self.compare()
        self.next_due = self._channel.wiring.clock.now() + EVERY_S

    def compare(self) -> None:
        """Compare now; nothing may be in flight."""
        if not self.unseen:
            return
        self._position.refuse_astray()
        self._heat.take_back()
        resets = blind_resets(self._channel.wiring.printer)
        self._channel.commands([one.encode() for one in resets if one.startswith(_SPEED)])
