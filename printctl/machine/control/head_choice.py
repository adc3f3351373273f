"""Select the head that a job uses, with confirmation by the firmware."""

from __future__ import annotations

from printctl.machine.control.channel import Channel
from printctl.machine.control.position_check import RETRIES
from printctl.machine.job.dispensing import choose, confirms, keep_raised
from printctl.machine.job.retreat import Retreat
from printctl.machine.records.states import LinkState, PrintEnded


class HeadChoice:
    """Does nothing where the printer has one head alone.

    Parameters
    ----------
    channel : Channel
    """

    def __init__(self, channel: Channel) -> None:
        self._channel, self._progress = channel, channel.logbook.progress
        self._printer = channel.wiring.printer

    @property
    def retreat(self) -> Retreat:
        """Relief and prime of the head in use."""
        return self._channel.wiring.retreat.of_head(self._progress.head)

    def take(self) -> None:
        """Choose the head that the job has in use, and see that it is; the others are raised.

        Before any move after a time in which somebody else may have chosen another.
        """
        number, progress = self._progress.head, self._progress
        if number is not None:
            self._channel.commands(keep_raised(progress.job.lines, progress.done, self._printer))
            self.choose(number)

    def choose(self, number: int) -> None:
        """Have the firmware use a head, and say so.

        Raises
        ------
        PrintEnded
            When it doesn't.
        """
        printer = self._printer
        for _ in range(RETRIES):  # an answer may be garbled
            if confirms(self._channel.command(choose(printer, number)), printer, number):
                return
        raise PrintEnded(
            LinkState.POSITION_UNKNOWN,
            f"the firmware doesn't say that it uses head {number} ({choose(printer, number)!r}): "
            "nothing was moved; see that it was built with so many, then `printctl status`",
            known=False,
        )
