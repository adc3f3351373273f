"""Stream one job to a printer: one thread runs the print, any thread may query or stop it.

The states are in ``docs/link_reference.md``; the sequence is in
`printctl.machine.control.printing.printing`, its context in
`printctl.machine.control.printing.context`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from printctl.checks.gate import LineOrigin, judge
from printctl.machine.control.board.halting import UNCONFIRMED
from printctl.machine.control.board.shell import carry_out_rest, drive, write_down
from printctl.machine.control.board.steps import Steps, carried_out
from printctl.machine.control.board.wiring import Wiring
from printctl.machine.control.excursion import CHANGE
from printctl.machine.control.gating import allowed_command
from printctl.machine.control.look_book import LookRequest
from printctl.machine.control.printing.aftermath import aftermath_of
from printctl.machine.control.printing.context import Print
from printctl.machine.control.printing.ending import shut_valve_past_protocol
from printctl.machine.control.printing.pausing import wanted_pause
from printctl.machine.control.printing.printing import run_print
from printctl.machine.control.requests import ManualCommand, Request, ResumeRequest
from printctl.machine.errors import HandshakeError, LinkError, PortLost, Refused
from printctl.machine.job.care import Care, NewSyringe
from printctl.machine.job.job import Job
from printctl.machine.job.marks import MarkKind
from printctl.machine.records.replay import JournalledPrint
from printctl.machine.records.states import LinkState, PrintEnded, Status

__all__ = ["Streamer", "Wiring"]


class Streamer:
    """Door to one print: a request is checked at once, then queued for the next gap of two lines.

    ``job`` has the inserts of the journal, where a print is gone on with.
    """

    def __init__(self, wiring: Wiring, job: Job, care: Care | None = None) -> None:
        self.wiring, self.protocol = wiring, wiring.protocol
        self.print = Print(wiring, job, care or Care())

    def run(self, history: JournalledPrint | None = None) -> Status:
        """Print, from handshake to end; return the last status. No fault of the printer raises.

        With a history, of the same job whose process died, go on from the printer's last line.
        """
        status = drive(self.steps(history), self.wiring)
        self.print.channel.kill.end()
        self.wiring.on_status(status)
        carry_out_rest(self.wiring)  # an alarm of whoever heard of the end
        return status

    def steps(self, history: JournalledPrint | None = None) -> Steps[Status]:
        """Print as `run` does, by steps."""
        run = self.print
        try:
            try:
                yield from self._to_the_end(history)
            except LinkError as exc:
                raise self._ended_by(exc) from exc
        except PrintEnded as ended:
            yield from shut_valve_past_protocol(run, ended)
            ended.message += str(aftermath_of(run, ended))
            return run.logbook.end(ended)
        raise AssertionError("run_print always raises")

    def _to_the_end(self, history: JournalledPrint | None) -> Steps[None]:
        try:
            yield from run_print(self.print, history)
        except PrintEnded:
            yield from carried_out()  # before the end is written down
            raise

    def _ended_by(self, exc: LinkError) -> PrintEnded:
        name, logbook = type(exc).__name__, self.print.logbook
        if self.print.channel.kill.asked.is_set():
            message = f"emergency stop by the user; {exc}; {UNCONFIRMED}"
            return PrintEnded(LinkState.KILLED, message, False, name)
        if isinstance(exc, PortLost):
            words = logbook.progress.words()
            message = f"{exc}; {words}, the next may have been accepted"
            return PrintEnded(LinkState.FAILED, message, False, name)
        known = isinstance(exc, HandshakeError) and not logbook.resumed
        return PrintEnded(LinkState.FAILED, str(exc), known, name)

    def alarm(self, text: str) -> None:
        """Write down what a person must see, found outside of the print itself."""
        self.print.logbook.alarm(text)

    # --- for any thread

    def note(self, action: dict[str, Any]) -> None:
        """Have a request written down, and by whom, by the thread that speaks to the printer."""
        self.print.logbook.record("action", **action)

    @property
    def job(self) -> Job:
        """The job as it has grown."""
        return self.print.job

    @property
    def status(self) -> Status:
        """The print as it stands."""
        return self.print.logbook.status

    def kill(self) -> None:
        """Halt the firmware at once; see `Kill.strike`."""
        self.print.channel.kill.strike()

    def stop(self, by: str = "the user") -> None:
        """Request a controlled stop; ``by``: whose word it is, for the message."""
        self.print.queue.add(Request.STOP, by=by)

    def pause(self, after: MarkKind | None = None) -> None:
        """Request a pause: now, or at the next mark of a kind; `Refused` with none ahead."""
        run = self.print
        if after is None:
            run.queue.add(Request.PAUSE)
            return
        job, done = run.job, run.progress.done
        if job.marks.next(after, done) is None:
            change = after is MarkKind.RELOAD
            what = "safe reload point" if change else f"end of a {after}"
            then = ", then `printctl reload RUN` raises the needle there" if change else ""
            raise Refused(
                f"{job.name} has no {what} after line {job.file_line(done)}; pause now instead "
                f"(`printctl pause RUN`){then}"
            )
        write_down(wanted_pause(run, after), self.wiring)  # before the client hears of it
        run.queue.add(Request.LOOK)

    def reload(self, head: int | None = None) -> None:
        """Request a change of syringe: at the next reload point, or here when it is paused.

        Of several heads that of ``head``, or of the one in use there. `Refused` when the job has no
        reload point ahead, or the printer no such head.
        """
        run = self.print
        count = len(run.printer.heads)
        if head is not None and not 0 <= head < count:
            raise Refused(
                f"head {head} doesn't exist: {run.printer.name} "
                + (f"has 0 to {count - 1}" if count else "has only one; omit it")
            )
        run.change.wanted_head = head
        if run.logbook.state in (LinkState.PAUSED, LinkState.LOOKING):
            run.queue.add(Request.RELOAD)
        else:
            self.pause(MarkKind.RELOAD)

    def resume(
        self,
        change: NewSyringe | None = None,
        unchanged: bool = False,
        unobserved: bool = False,
        answer: Callable[[str], None] = lambda why: None,
    ) -> None:
        """Request to go on after a pause; takes back a pause that is still waited for.

        In a pause for a change of syringe ``change`` is what was put in, or nothing was with
        ``unchanged``; else it is `Refused`. With ``unobserved`` a failed look isn't made again;
        ``answer``: see `ResumeRequest`.
        """
        run, state = self.print, self.print.logbook.state
        changing = run.change.going_on
        if changing and state is LinkState.PAUSED and not (change or unchanged):
            raise Refused(f"the print is paused for a syringe change: {CHANGE}")
        if change and not changing:
            raise Refused(
                "the print isn't paused for a syringe change: use `printctl reload RUN` first, so "
                "that the change is in the journal"
            )
        if change and state is LinkState.PAUSING:
            raise Refused(
                "the print isn't paused yet: the needle is being lifted for the change; specify "
                "the new syringe once `printctl status RUN` reports paused"
            )
        run.watch.unobserved = unobserved
        # where it isn't paused yet, a syringe would be of the next change
        given = (change, unchanged) if state is LinkState.PAUSED else (None, False)
        run.queue.add(ResumeRequest(*given, answer))

    def look(self, request: LookRequest) -> None:
        """Request an insert where the print is held for a look, or the look's end.

        `Refused` for another look, or where it contradicts what was requested before.
        """
        run = self.print
        if run.logbook.status.ended:
            raise Refused("the print has ended")
        answer = run.book.repeated(request)
        if answer is not None:
            request.done(answer)
        else:
            run.queue.looks.append(request)

    def alive(self) -> None:
        """Confirm that somebody is there: the dead-man's time begins anew."""
        self.print.watch.confirmed = self.wiring.clock.now()

    def command(self, text: bytes, done: Callable[[tuple[bytes, ...]], None]) -> None:
        """Request a command of the product's own between two lines; ``done`` gets the reply."""
        self.print.queue.commands.append(ManualCommand(text.decode("ascii"), done))

    def typed(
        self,
        text: str,
        done: Callable[[tuple[bytes, ...]], None],
        refused: Callable[[str], None],
    ) -> None:
        """Request a command that a person typed; the gate judges it now and when it is sent."""
        if self.print.logbook.state is not LinkState.PAUSED:
            known = self.wiring.printing_limits()
            text = allowed_command(judge(text, LineOrigin.CONSOLE, known)).text
        self.print.queue.commands.append(ManualCommand(text, done, refused))
