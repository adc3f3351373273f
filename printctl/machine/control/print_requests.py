"""Check requests of other threads to a running print: refuse at once, or queue for the print."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from printctl.checks.gate import Phase
from printctl.machine.control.gating import Manual, allowed_command, judge_typed
from printctl.machine.control.logbook import Logbook
from printctl.machine.control.requests import Request, RequestQueue, ResumeRequest
from printctl.machine.control.syringe_change import CHANGE, SyringeChange
from printctl.machine.control.watch import Watch
from printctl.machine.control.wiring import Wiring
from printctl.machine.errors import Refused
from printctl.machine.job.care import NewSyringe
from printctl.machine.job.marks import MarkKind
from printctl.machine.records.journal import Record
from printctl.machine.records.states import LinkState


class PrintRequests:
    """Takes requests for one print; the streamer's thread grants them between two lines.

    Parameters
    ----------
    wiring : Wiring
    logbook : Logbook
    queue : RequestQueue
    watch : Watch
    change : SyringeChange
    """

    def __init__(
        self,
        wiring: Wiring,
        logbook: Logbook,
        queue: RequestQueue,
        watch: Watch,
        change: SyringeChange,
    ) -> None:
        self._wiring, self._logbook, self._progress = wiring, logbook, logbook.progress
        self._queue, self._watch, self._change = queue, watch, change
        self._reload_head: int | None = None

    # --- for any thread --------------------------------------------------------------------------

    def stop(self) -> None:
        """Ask for a controlled stop."""
        self._queue.add(Request.STOP)

    def pause(self, after: MarkKind | None = None) -> None:
        """Ask for a pause: now, or once a layer or vessel has ended.

        Raises
        ------
        Refused
            When the job has no such mark ahead.
        """
        if after is None:
            self._queue.add(Request.PAUSE)
            return
        job, done = self._progress.job, self._progress.done
        if job.marks.next(after, done) is None:
            change = after is MarkKind.RELOAD
            what = "safe reload point" if change else f"end of a {after}"
            then = ", then `printctl reload RUN` makes room there" if change else ""
            raise Refused(
                f"{job.name} marks no {what} after line {job.file_line(done)}; pause at once "
                f"instead (`printctl pause RUN`){then}"
            )
        self.want(after)
        self._queue.add(Request.LOOK)

    def reload(self, head: int | None = None) -> None:
        """Ask for a change of syringe: at the next reload point, or here when it is paused.

        Of several heads that of ``head``, or of the one in use there.

        Raises
        ------
        Refused
            When the job has no reload point ahead, or the printer no such head.
        """
        printer = self._wiring.printer
        count = len(printer.heads)
        if head is not None and not 0 <= head < count:
            raise Refused(
                f"there is no head {head} to change the syringe of: {printer.name} "
                + (f"has 0 to {count - 1}" if count else "has one alone; don't name it")
            )
        self._reload_head = head
        if self._logbook.state in (LinkState.PAUSED, LinkState.LOOKING):
            self._queue.add(Request.RELOAD)
        else:
            self.pause(MarkKind.RELOAD)

    def want(self, after: MarkKind | None) -> None:
        """Have the print held at the next mark of a kind, None for no longer; write it down."""
        self._watch.pause_after(after)
        head = {} if after is not MarkKind.RELOAD else {"head": self._reload_head}
        self._logbook.record("wanted", after=after or "", **head)

    def resume(
        self,
        change: NewSyringe | None = None,
        unchanged: bool = False,
        unobserved: bool = False,
        answer: Callable[[str], None] = lambda why: None,
    ) -> None:
        """Ask to go on after a pause; takes back a pause that is still waited for.

        Parameters
        ----------
        change : NewSyringe, optional
            What was put in, in a pause for a change of syringe.
        unchanged : bool
            The syringe wasn't changed after all.
        unobserved : bool
            A look that failed isn't made again.
        answer : callable
            See `ResumeRequest`.

        Raises
        ------
        Refused
            When a change of syringe is to be told, or is told where none is going on.
        """
        paused = self._logbook.state is LinkState.PAUSED
        if self._change.going_on and paused and not (change or unchanged):
            raise Refused(f"the print is paused for a change of syringe: {CHANGE}")
        if change and not self._change.going_on:
            raise Refused(
                "the print isn't paused for a change of syringe: `printctl reload RUN` first, so "
                "that the change is in the journal"
            )
        if change and self._logbook.state is LinkState.PAUSING:
            raise Refused(
                "the print isn't paused yet: the needle is being lifted for the change; tell the "
                "new syringe once `printctl status RUN` says paused"
            )
        self._watch.unobserved = unobserved
        told = (change, unchanged) if paused else (None, False)  # else it's of the next change
        self._queue.add(ResumeRequest(*told, answer))

    def alive(self) -> None:
        """Confirm that somebody is there: the dead-man's time begins anew."""
        self._watch.confirm(self._wiring.clock.now())

    def command(self, text: bytes, done: Callable[[tuple[bytes, ...]], None]) -> None:
        """Ask for a command of the product's own between two lines; ``done`` is told the reply."""
        self._queue.add_command(Manual(text.decode("ascii"), done))

    def typed(
        self,
        text: str,
        done: Callable[[tuple[bytes, ...]], None],
        refused: Callable[[str], None],
    ) -> None:
        """Ask for a command that a person typed; the gate judges it once more when it is sent.

        Raises
        ------
        Refused
            When it passes in no state, or not while the print goes on.
        """
        if self._logbook.state is not LinkState.PAUSED:
            known = replace(self._wiring.limits(), phase=Phase.PRINTING)
            text = allowed_command(judge_typed(text, known)).text
        self._queue.add_command(Manual(text, done, refused))

    # --- for the streamer's thread ---------------------------------------------------------------

    @property
    def reload_head(self) -> int | None:
        """Whose syringe somebody wants changed; None where nobody said."""
        return self._reload_head

    def remember(self, wanted: Record | None) -> None:
        """Go on wanting what somebody asked a process for that died; ``wanted`` of its journal."""
        if wanted is not None:
            self._reload_head = wanted.get("head")
            self._watch.pause_after(MarkKind(wanted["after"]))
