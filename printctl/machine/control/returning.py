"""Return the needle to the job's position: lower in steps, restore the plunger, verify."""

from __future__ import annotations

from dataclasses import dataclass, replace

from printctl.machine.control.channel import Channel
from printctl.machine.control.excursion import Excursion
from printctl.machine.control.head_choice import HeadChoice
from printctl.machine.control.position_check import PositionCheck
from printctl.machine.job.coordinates import Modal


@dataclass(frozen=True)
class Returning:
    """Returns the needle to the job's position.

    Attributes
    ----------
    channel : Channel
    heads : HeadChoice
    position : PositionCheck
    excursion : Excursion
    """

    channel: Channel
    heads: HeadChoice
    position: PositionCheck
    excursion: Excursion

    def come_back(self, at: Modal, prime_mm: float = 0.0) -> None:
        """Lower the needle to ``at``, push the plunger to its place, and compare both.

        Each step of the way down is waited for, so that a stop finds no further one ahead.

        Raises
        ------
        PrintEnded
            Where the place can't be read, or isn't the job's.
        """
        channel, retreat = self.channel, self.heads.retreat
        printer = channel.wiring.printer
        height = self.position.height()
        self.excursion.come_back(height)
        for move in retreat.lower(at, printer, height):
            channel.command(move)
            channel.command(b"M400")
        channel.commands(retreat.rejoin(replace(at, z=None), printer, prime_mm))
        channel.command(b"M400")
        self.position.verify(at)
        self.excursion.end()
