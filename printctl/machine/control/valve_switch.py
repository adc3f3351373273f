"""Control a pneumatic head's valve during a print: shut before lifting, open after return."""

from __future__ import annotations

import contextlib

from printctl.machine.control.channel import Channel
from printctl.machine.errors import PortLost
from printctl.machine.job.dispensing import reopen, shut, shut_and_wait
from printctl.machine.records.states import LinkState, PrintEnded


class ValveSwitch:
    """Does nothing where the printer has no valve.

    Parameters
    ----------
    channel : Channel
    """

    def __init__(self, channel: Channel) -> None:
        self._channel, self._logbook = channel, channel.logbook
        self._printer = channel.wiring.printer
        self._shut = False

    def shut(self) -> None:
        """Shut the valve: before the needle is lifted, and before questions."""
        for command in shut_and_wait(self._printer):
            self._channel.command(command)
            self._shut = True

    def reopen(self) -> None:
        """Open it again where the link had shut it within a path, with the tip back in place."""
        if self._shut:
            progress = self._logbook.progress
            self._channel.commands(reopen(progress.job.lines, progress.done, self._printer))
        self._shut = False

    def shut_past_protocol(self, ended: PrintEnded) -> None:
        """Shut it where the protocol can't go on but the wire is there.

        Without number and checksum, twice: the last thing that is said, whatever the printer makes
        of it. A firmware that was killed takes nothing; one that was reset may take it.
        """
        lost = ended.state not in (LinkState.FAILED, LinkState.POSITION_UNKNOWN)
        portless = ended.error == PortLost.__name__
        if lost or ended.known or portless or not self._logbook.begun:
            return
        for command in shut(self._printer):
            self._logbook.notice("the valve is told to shut, past the protocol")
            with contextlib.suppress(PortLost):
                self._channel.wiring.transport.write_urgent(b"\n%b\n%b\n" % (command, command))
