"""Restore modes, settings, heater targets and feed rate after another program's commands."""

from __future__ import annotations

from dataclasses import dataclass

from printctl.machine.control.channel import Channel
from printctl.machine.control.firmware_check import FirmwareCheck
from printctl.machine.control.heat_check import HeatCheck
from printctl.machine.control.position_check import PositionCheck
from printctl.machine.errors import HandshakeError
from printctl.machine.families import link_facts


@dataclass(frozen=True)
class ForeignCommands:
    """Has a printer that others wrote to as the job counts on.

    M114 tells where a printer is, not how it reads the next line: relative places, a flow factor
    or other steps per mm would spoil the rest of the print.

    Attributes
    ----------
    channel : Channel
    firmware : FirmwareCheck
    position : PositionCheck
    heat : HeatCheck
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
        progress, printer = self.channel.logbook.progress, self.channel.wiring.printer
        self.firmware.set_modes(journalled=True)
        if link_facts(printer).tells_steps:
            self.firmware.check_steps(journalled=True)
        self.firmware.agree_settings(journalled=True)
        self.heat.take_back()
        feed = progress.modal().f
        if feed is not None:
            self.channel.command(b"G1 F%b" % f"{feed:g}".encode())
