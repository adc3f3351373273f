"""Stream one job to a printer: one thread runs the print, any thread may query or stop it.

The states are in ``docs/link_reference.md``; the sequence is in
`printctl.machine.control.print_loop`, its parts are put together in
`printctl.machine.control.print_parts`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from printctl.machine.control.look_book import Answer, LookDecision
from printctl.machine.control.print_loop import PrintLoop
from printctl.machine.control.print_parts import assemble
from printctl.machine.control.wiring import Wiring
from printctl.machine.errors import HandshakeError, LinkError, PortLost
from printctl.machine.job.care import Care, NewSyringe
from printctl.machine.job.job import Job
from printctl.machine.job.marks import MarkKind
from printctl.machine.records.journalled_print import JournalledPrint
from printctl.machine.records.states import LinkState, PrintEnded, Status

__all__ = ["Streamer", "Wiring"]


class Streamer:
    """One printer and one job.

    Parameters
    ----------
    wiring : Wiring
    job : Job
        With the inserts of the journal, where a print is gone on with.
    care : Care, optional

    Attributes
    ----------
    parts : PrintParts
    """

    def __init__(self, wiring: Wiring, job: Job, care: Care | None = None) -> None:
        self.wiring, self.protocol = wiring, wiring.protocol
        self.parts = assemble(wiring, job, care or Care())
        self._logbook, self._kill = self.parts.channel.logbook, self.parts.channel.kill
        self._requests = self.parts.requests

    def run(self, history: JournalledPrint | None = None) -> Status:
        """Print, from handshake to end.

        Parameters
        ----------
        history : JournalledPrint, optional
            Journal of the same job, whose link process died: go on from the printer's last line.

        Returns
        -------
        Status
            The last one; nothing that a printer or a cable does raises.
        """
        try:
            try:
                PrintLoop(self.parts).run(history)
            except LinkError as exc:
                raise self._ended_by(exc) from exc
        except PrintEnded as ended:
            self.parts.valve.shut_past_protocol(ended)
            status = self._logbook.end(ended)
        self._kill.end()
        self.wiring.on_status(status)
        return status

    def _ended_by(self, exc: LinkError) -> PrintEnded:
        name = type(exc).__name__
        if self._kill.asked.is_set():
            return PrintEnded(LinkState.KILLED, f"killed by the user; {exc}", False, name)
        if isinstance(exc, PortLost):
            words = self._logbook.progress.words()
            message = f"{exc}; {words}, the next may have been taken; position unknown"
            return PrintEnded(LinkState.FAILED, message, False, name)
        known = isinstance(exc, HandshakeError) and not self._logbook.resumed
        return PrintEnded(LinkState.FAILED, str(exc), known, name)

    def alarm(self, text: str) -> None:
        """Write down what a person must see, found outside of the print itself."""
        self._logbook.alarm(text)

    # --- for any thread --------------------------------------------------------------------------

    @property
    def job(self) -> Job:
        """The job as it has grown."""
        return self._logbook.progress.job

    @property
    def status(self) -> Status:
        """The print as it stands."""
        return self._logbook.status

    def kill(self) -> None:
        """Halt the firmware at once; see `Kill.strike`."""
        self._kill.strike()

    def stop(self) -> None:
        """Ask for a controlled stop."""
        self._requests.stop()

    def pause(self, after: MarkKind | None = None) -> None:
        """Ask for a pause; see `PrintRequests.pause`."""
        self._requests.pause(after)

    def reload(self, head: int | None = None) -> None:
        """Ask for a change of syringe; see `PrintRequests.reload`."""
        self._requests.reload(head)

    def resume(
        self,
        change: NewSyringe | None = None,
        unchanged: bool = False,
        unobserved: bool = False,
        answer: Callable[[str], None] = lambda why: None,
    ) -> None:
        """Ask to go on after a pause; see `PrintRequests.resume`."""
        self._requests.resume(change, unchanged, unobserved, answer)

    def insert(
        self,
        look: int,
        lines: Sequence[str],
        why: str,
        done: Callable[[Answer], None],
        refused: Callable[[str], None],
        flow: float | None = None,
        again: bool = False,
    ) -> None:
        """Ask for lines to be put into the job; see `LookRequests.insert`."""
        self.parts.look_requests.insert(look, lines, why, done, refused, flow, again)

    def look_done(
        self,
        look: int,
        decision: LookDecision,
        why: str,
        done: Callable[[Answer], None],
        refused: Callable[[str], None],
        again: bool = False,
    ) -> None:
        """Ask for a look to end; see `LookRequests.decide`."""
        self.parts.look_requests.decide(look, decision, why, done, refused, again)

    def alive(self) -> None:
        """Confirm that somebody is there."""
        self._requests.alive()

    def command(self, text: bytes, done: Callable[[tuple[bytes, ...]], None]) -> None:
        """Ask for a command of the product's own; see `PrintRequests.command`."""
        self._requests.command(text, done)

    def typed(
        self,
        text: str,
        done: Callable[[tuple[bytes, ...]], None],
        refused: Callable[[str], None],
    ) -> None:
        """Ask for a command that a person typed; see `PrintRequests.typed`."""
        self._requests.typed(text, done, refused)
