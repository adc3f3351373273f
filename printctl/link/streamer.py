"""Streams a job to a printer: the sequence of a print, from handshake to end.

The states are in ``docs/link.md``; how one step is done is in `printctl.link.channel`, how a print
is held and gone on with in `printctl.link.pausing`.
"""

from __future__ import annotations

import contextlib
from dataclasses import replace
from typing import Final

from printctl.gate import Known, Phase
from printctl.link.agreeing import agree_start
from printctl.link.care import Care
from printctl.link.channel import POLL_S, Over, Wiring
from printctl.link.errors import LinkError
from printctl.link.families import family_of
from printctl.link.job import Job
from printctl.link.journal import History
from printctl.link.marks import MarkKind
from printctl.link.modal import astray, named
from printctl.link.pausing import Pausing
from printctl.link.recovering import declared_start
from printctl.link.states import LinkState, Status
from printctl.link.valve import is_open

__all__ = ["Streamer", "Wiring"]

SOONEST_LINES: Final = 5
"""So many lines after an error the position is compared: a word garbled past the checksum (X to Z)
stays wrong until a later line gives it again."""
CHECK_LINES: Final = 40
"""Twice as many after each comparison that agrees, up to this."""
NOISY_LINES: Final = 250
"""For so many lines after an error a line counts as one that makes errors."""
AGAIN_LINES: Final = 2
"""After so many more a position that was wrong is compared again."""


class Streamer(Pausing):
    """One print; see `Pausing` for what it is given."""

    def __init__(self, wiring: Wiring, job: Job, care: Care | None = None) -> None:
        super().__init__(wiring, job, care)
        self._checked = self._errors_seen = self._noisy_until = 0
        self._check_every = SOONEST_LINES
        self._slip = ""

    # --- the print -------------------------------------------------------------------------

    def run(self, history: History | None = None) -> Status:
        """Print, from handshake to end.

        Parameters
        ----------
        history : History, optional
            Journal of the same job, whose link process died: go on from the printer's last line.

        Returns
        -------
        Status
            The last one; nothing that a printer or a cable does raises.
        """
        try:
            try:
                self._run(history)
            except LinkError as exc:
                raise self._broken(exc) from exc
        except Over as over:
            self._shut_valve_anyhow(over)
            status = self._record_end(over)
        self._ended.set()
        self.wiring.on_status(status)
        return status

    def _run(self, history: History | None) -> None:
        self._enter(LinkState.CONNECTING, f"opening {self.wiring.transport.name}")
        if history is None:
            self._connect()
            self._enter(LinkState.CHECKING, "asking the firmware what it is")
            self._check()
            self._agree_start()
            self.protocol.load(self.job.lines, 0, self._agree(self.protocol.renumber))
        else:
            self._find_again(history)
        self.watch.begin(self.wiring.clock.now())
        self._enter(LinkState.PRINTING, f"printing {self.job.name}")
        self._open_valve()
        while not self._at_end():
            self._stream()
            self._obey()
            if self.protocol.lines_done < len(self.job):
                self._at_mark()
        raise Over(LinkState.DONE, f"all {len(self.job)} lines done")

    def _at_end(self) -> bool:
        """Whether every line was taken and every move made, and nobody minds."""
        if self.protocol.lines_done < len(self.job):
            return False
        confirmed = self._finish()
        self._end_on_fault()  # of the last moves
        self._obey()  # a stop while the last moves were made: the way out needs the job's settings
        if confirmed:
            self._undo_settings()
        return confirmed

    def _stream(self) -> None:
        """Send lines until the job is at a mark or its end, or somebody wishes something.

        This loop is the hot path of the link: one write, one poll and one read a line.
        """
        protocol, transport = self.protocol, self.wiring.transport
        now_s, read, take = self.wiring.clock.now, transport.read, protocol.take_output
        feed, wishes, commands = protocol.feed, self._wishes, self._commands
        self._measure(now_s())
        self._end_on_fault()
        if self._noisy():
            self._look_for_slips()
        now = now_s()
        stop = protocol.limit = self._next_stop(now)
        if not self._unverified:
            protocol.held = False
            protocol.go(now)
        while protocol.lines_done < stop and not wishes and not commands:
            output = take()
            if output:
                transport.write(output)
            wait = protocol.deadline - now
            data = read(wait if wait < POLL_S else POLL_S)
            now = now_s()
            if data:
                events = feed(data, now)
                if events:
                    self._handle(events)
            if now >= protocol.deadline:
                self._handle(protocol.tick(now))
            if now >= self._next_note:
                self._note(now)
                stop = protocol.limit = min(stop, self._next_stop(now))
            if self._fault:
                self._end_on_fault()
            if self._unverified:
                self._verify_in_passing()
            if self._killed.is_set():
                self._await_halt()

    def _measure(self, now: float) -> None:
        """Ask for what is watched and due; end the print where a reading is above its limit."""
        if not self._gauge_due(now):
            return
        self._settle()
        high = self._too_high(now)
        if high and not self._fault:
            self._alarm(high)
            self._retreat_and_end(LinkState.FAILED, high)

    def _end_on_fault(self) -> None:
        if self._fault:
            self._settle()
            self._retreat_and_end(LinkState.FAILED, self._fault)

    def _noisy(self) -> bool:
        """Whether to compare the position: soon after an error, and often for a while."""
        errors, done = self.protocol.line_errors, self.protocol.lines_done
        if errors != self._errors_seen:
            self._errors_seen, self._noisy_until = errors, done + NOISY_LINES
            self._check_every = AGAIN_LINES if self._slip else SOONEST_LINES
        return done < self._noisy_until and done - self._checked >= self._check_every

    def _look_for_slips(self) -> None:
        """Compare the position; where the next lines put it right, again after them.

        A word that was garbled past the checksum and given again since did its harm; the print
        goes on, with an alarm. One that would stay wrong (a Z within a layer) ends it at once.
        """
        self._settle()
        done = self._checked = self.protocol.lines_done
        at = self._trail.at(done)
        wrong, position = ("", {}) if self._slip else self._compare(at)
        soon = set(named(self.job.lines[done : done + AGAIN_LINES]))
        if wrong and position and soon.issuperset(astray(at, position)):
            self._slip = f"after line {done}: {wrong}"
            self._check_every, self._noisy_until = AGAIN_LINES, done + NOISY_LINES
            return
        self._verify(at)
        self._check_every = min(2 * self._check_every, CHECK_LINES)
        if self._slip:
            self._alarm(f"{self._slip}: a line slipped through its checksum; look at the part")
            self._slip = ""

    def _next_stop(self, now: float) -> int:
        """Command lines after which to look at what is due."""
        protocol, done = self.protocol, self.protocol.lines_done
        stop = self.watch.next_stop(now, done, protocol.idle, len(self.job))
        if self._noisy() or self._gauge_due(now):
            return done
        if done >= self._noisy_until:
            return stop
        return min(stop, max(self._checked + self._check_every, done + 1))

    def _obey(self) -> None:
        """Do what was wished, with no line in flight."""
        self._settle()
        while self._commands:
            self._carry_out(self._commands.popleft(), self._printing)
        while self._wishes:
            wish = self._wishes.popleft()
            if wish == "stop":
                self._retreat_and_end(LinkState.STOPPED, "stopped by the user")
            elif wish == "pause":
                self._pause()
            elif wish == "resume":
                self.watch.after = None  # a pause that is waited for no longer
            elif wish == "reload":  # wished in a pause that is over
                self.watch.after = MarkKind.RELOAD

    def _printing(self) -> Known:
        """What the gate is told while lines go out."""
        return replace(self.wiring.limits(), phase=Phase.PRINTING)

    def _agree_start(self) -> None:
        """Refuse a tip that stands elsewhere than preflight took it to stand."""
        if self.care.start_mm is None:
            return
        declared = None
        with contextlib.suppress(LinkError):  # a frame that moves later: the printer is asked
            declared = declared_start(self.job, len(self.job))
        agree_start(lambda text: self._command(text, False), self.care.start_mm, declared)

    # --- found again -------------------------------------------------------------------------

    def _find_again(self, history: History) -> None:
        """Ask a printer in mid-job for its last line, and go on from there if all agrees."""
        self._resumed = True
        if not family_of(self.wiring.printer).remembers:
            raise Over(
                LinkState.POSITION_UNKNOWN,
                f"{self.wiring.printer.firmware} can't tell which line it took last; at least "
                f"{history.done} job lines were taken; `printctl status` says what next",
                known=False,
            )
        number = self._agree(self.protocol.ask)
        done = history.job_line(number)
        reset = self._booted or (number == 0 and history.done > 0)
        if reset or not history.done <= done <= len(self.job):
            raise Over(
                LinkState.POSITION_UNKNOWN,
                f"the printer's last line is {number}, the journal knows of {history.done} job "
                "lines: it was reset or used by another program since; `printctl status` says "
                "what next",
                known=False,
            )
        self.protocol.load(self.job.lines, done, number)
        self._record("ack", done=done)
        self._shut_valve()
        if is_open(self.job.lines, done, self.wiring.printer):
            self._alarm(f"the valve stood open after line {done} while no host was there; look")
        self._check_keepalive(journalled=True)
        self._command(b"M400")
        self._settings = history.settings
        self._agree_settings(journalled=True)
        at = self._where()
        if history.reload_at is not None:
            self.watch.reload_at = history.reload_at
            self.watch.reload_heads = history.reload_heads
        if history.reloaded == done:
            self.watch.paused(done)
        if history.changing(number):
            self._await_syringe(at, None if history.reload is None else history.reload.get("head"))
            return
        self._take_head()
        self._verify(replace(at, z=None, e=None))  # a pause may have lifted and relieved
        for command in self._retreat.rejoin(at, self.wiring.printer):
            self._command(command)
        self._command(b"M400")
        self._verify(at)

    # --- finishing ---------------------------------------------------------------------------

    def _finish(self) -> bool:
        """Wait for the last move; whether the printer confirms its last line."""
        self._settle()
        self._command(b"M400")
        if self._unverified or self._noisy() or self.protocol.lines_done < self._noisy_until:
            self._unverified = False
            self._verify(self._trail.at(self.protocol.lines_done))
        number = self.protocol.number
        return self._agree(self.protocol.ask) == number
