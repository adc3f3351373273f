"""Take back what other programs changed: modes, settings, heater targets, feed rate, speed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from printctl.checks.gate.firmware import blind_resets
from printctl.machine.control.channel import Channel
from printctl.machine.control.firmware import FirmwareCheck
from printctl.machine.control.heat import HeatCheck
from printctl.machine.control.place import PositionCheck
from printctl.machine.errors import HandshakeError
from printctl.machine.families import link_facts

EVERY_S: Final = 1.0
"""Interval of comparisons: three lines and their answers, for which nothing stands still."""
_SPEED: Final = "M220"


@dataclass(frozen=True)
class ForeignCommands:
    """Has a printer that others wrote to as the job counts on.

    M114 tells where a printer is, not how it reads the next line: relative places, a flow factor
    or other steps per mm would spoil the rest of the print.
    """

    channel: Channel
    firmware: FirmwareCheck
    position: PositionCheck
    heat: HeatCheck

    def take_back(self) -> None:
        """`set_anew` where lines weren't ours.

        Raises
        ------
        PrintEnded
            For what no command takes back.
        """
        progress = self.channel.logbook.progress
        if not progress.meddled:
            return
        progress.meddled = False
        try:
            self.set_anew()
        except HandshakeError as exc:
            self.position.end_astray(str(exc))

    def own_modes(self) -> None:
        """Set modes before moves of the link's own, where another client's leave no trace."""
        if link_facts(self.channel.wiring.printer).place_question:
            self.firmware.set_modes(journalled=True)

    def set_anew(self) -> None:
        """Set modes, factors, limits, heaters and feed rate as the job has them; none in flight.

        Raises
        ------
        HandshakeError
            For what no command takes back.
        """
        self.firmware.set_modes(journalled=True)
        if link_facts(self.channel.wiring.printer).tells_steps:
            self.firmware.check_steps(journalled=True)
        self.firmware.agree_settings(journalled=True)
        self.heat.take_back()
        feed = self.channel.logbook.progress.modal().f
        if feed is not None:
            self.channel.command(b"G1 F%b" % f"{feed:g}".encode())


class OtherClients:
    """Notices what another client of the printer has changed, by asking for it.

    Klipper answers each client alone: a G91, M221 or SET_GCODE_OFFSET of another one is reported
    to no other. What it doesn't tell at all (the speed factor) is set anew.

    Attributes
    ----------
    next_due : float, s
        When they are compared next; infinite where other programs' lines are noticed by themselves.
    """

    def __init__(self, channel: Channel, position: PositionCheck, heat: HeatCheck) -> None:
        self._channel, self._position, self._heat = channel, position, heat
        self._unseen = bool(link_facts(channel.wiring.printer).place_question)
        self.next_due = math.inf

    def begin(self, now: float) -> None:
        """Compare for the first time a while after ``now``."""
        if self._unseen:
            self.next_due = now + EVERY_S

    def look(self, now: float) -> None:
        """Compare where that is due.

        Raises
        ------
        PrintEnded
            Where the next lines would lead elsewhere, or push otherwise, than the job says.
        """
        if now >= self.next_due:
            self._channel.settle()
            self.compare()
            self.next_due = self._channel.wiring.clock.now() + EVERY_S

    def compare(self) -> None:
        """Compare now; nothing may be in flight."""
        if not self._unseen:
            return
        self._position.refuse_astray()
        self._heat.take_back()
        resets = blind_resets(self._channel.wiring.printer)
        self._channel.commands([one.encode() for one in resets if one.startswith(_SPEED)])
