"""Send the manual and internal commands that wait for a gap between two job lines."""

from __future__ import annotations

from collections.abc import Callable

from printctl.checks.gate import PrinterSituation, Refusal
from printctl.machine.control.channel import Channel
from printctl.machine.control.gating import Manual, judge_typed
from printctl.machine.control.heat import HeatCheck
from printctl.machine.control.interruption import StopRequested
from printctl.machine.control.requests import RequestQueue


class ManualCommands:
    """Sends the pending manual commands.

    Parameters
    ----------
    channel : Channel
    requests : RequestQueue
    heat : HeatCheck
        Told of the targets that are set.
    """

    def __init__(self, channel: Channel, requests: RequestQueue, heat: HeatCheck) -> None:
        self._channel, self._logbook = channel, channel.logbook
        self._requests, self._heat = requests, heat

    def send_all(self, known: Callable[[], PrinterSituation]) -> None:
        """Send what waits; ``known`` is what the gate is told of the moment."""
        while (manual := self._requests.take_command()) is not None:
            self._send(manual, known)

    def _send(self, manual: Manual, known: Callable[[], PrinterSituation]) -> None:
        """Send a command, if the gate lets it pass as things stand.

        What the printer says against it ends no print: nothing else was under way.
        """
        if manual.refused is None:
            manual.done(self._channel.command(manual.text.encode("ascii")))
            return
        verdict = judge_typed(manual.text, known())
        if isinstance(verdict, Refusal):
            self._logbook.notice(verdict.message)
            manual.refused(verdict.message)
            return
        before = self._logbook.fault
        try:
            lines = self._channel.command(verdict.text.encode("ascii"))
        except StopRequested:
            manual.refused("the print is being stopped")
            raise
        complaint = self._logbook.excuse(before)
        if not complaint:
            self._heat.set_by_hand(verdict)
        said = (complaint.encode("ascii", "replace"),) if complaint else ()
        manual.done((*lines, *said))
