"""Main loop of a print: handshake, stream job lines, serve requests, await the last moves."""

from __future__ import annotations

import contextlib

from printctl.machine.control.channel import POLL_S
from printctl.machine.control.connecting import connect
from printctl.machine.control.interruption import StopRequested
from printctl.machine.control.print_parts import PrintParts
from printctl.machine.control.requests import Request, ResumeRequest
from printctl.machine.control.start_checks import RestWait, agree_start
from printctl.machine.errors import HandshakeError, LinkError
from printctl.machine.job.coordinates import declared_start
from printctl.machine.job.job import Job
from printctl.machine.job.marks import MarkKind
from printctl.machine.records.journalled_print import JournalledPrint
from printctl.machine.records.states import LinkState, PrintEnded


class PrintLoop:
    """Sends the lines of one print.

    Parameters
    ----------
    parts : PrintParts
    """

    def __init__(self, parts: PrintParts) -> None:
        self._parts, self._channel = parts, parts.channel
        self._logbook, self._progress = parts.channel.logbook, parts.channel.logbook.progress
        self._wiring, self._protocol = parts.channel.wiring, parts.channel.wiring.protocol
        self._compared = ""

    @property
    def _job(self) -> Job:
        """The job as it stands: it may grow while the print is held."""
        return self._progress.job

    def run(self, history: JournalledPrint | None) -> None:
        """Print, from handshake to end; see `Streamer.run`.

        Raises
        ------
        PrintEnded
            Always, but for a `LinkError`.
        """
        try:
            self._run(history)
        except StopRequested:
            self._parts.ending.stop()

    def _run(self, history: JournalledPrint | None) -> None:
        parts, logbook = self._parts, self._logbook
        if history is not None:
            logbook.go_on(history)
        logbook.enter(LinkState.CONNECTING, f"opening {self._wiring.transport.name}")
        if history is None:
            self._begin()
        else:
            parts.resumption.find_again(history)
        parts.watch.begin(self._wiring.clock.now())
        parts.answers.begin(self._wiring.clock.now())
        parts.clients.begin(self._wiring.clock.now())
        logbook.enter(LinkState.PRINTING, f"printing {self._job.name}")
        parts.valve.reopen()
        if history is not None:
            parts.looks.at_mark()  # it died before it held the print here
        while not self._at_end():
            self._stream()
            self._obey()
            parts.looks.at_mark()
        others = self._progress.foreign_words()
        look = f"; {others}: look at the part" if others else ""
        message = f"all {len(self._job)} lines done{self._compared}{look}{self._logbook.remarks}"
        raise PrintEnded(LinkState.DONE, message, known=not others)

    def _begin(self) -> None:
        rest = RestWait(self._channel)
        connect(self._channel, rest.step)
        self._logbook.enter(LinkState.CHECKING, "asking the firmware what it is")
        rest.wait()
        self._parts.firmware.check()
        self._agree_start(rest)
        self._parts.heat.begin()
        self._parts.frame.begin()
        self._parts.pauses.motors.hold()
        number = self._channel.agree(self._protocol.renumber)
        if self._logbook.fault and not self._logbook.disk_full:
            raise HandshakeError(f"{self._logbook.fault}; no line of the job was sent")
        self._protocol.load(self._job.lines, 0, number)

    def _agree_start(self, rest: RestWait) -> None:
        """Refuse a tip that stands elsewhere than preflight, or the job, takes it to stand."""
        declared = None
        with contextlib.suppress(LinkError):  # a part alone is told: the printer is asked
            declared = declared_start(self._job)
        rest.refuse_declared(declared)
        start_mm = self._parts.watch.care.start_mm
        if start_mm is not None:
            agree_start(self._channel.ask, start_mm, declared)

    # --- lines -----------------------------------------------------------------------------------

    def _stream(self) -> None:
        """Send lines until the job is at a mark or its end, or somebody asks for something.

        This loop is the hot path of the link: one write, one poll and one read a line.
        """
        protocol, transport, channel = self._protocol, self._wiring.transport, self._channel
        now_s, read, take = self._wiring.clock.now, transport.read, protocol.take_output
        feed, queue, progress = protocol.feed, self._parts.queue, self._progress
        requests, commands, logbook = queue.requests, queue.commands, self._logbook
        killed, heard = channel.kill.asked.is_set, channel.heard
        self._measure(now_s())
        self._parts.answers.look(now_s())
        self._parts.clients.look(now_s())
        self._parts.ending.end_on_fault()
        if progress.foreign and progress.unverified:
            self._verify()  # before a slip is looked for: that waits for moves that lead astray
        if self._parts.slips.due:
            self._parts.slips.look()
        now = now_s()
        stop = protocol.limit = self._next_stop(now)
        taken = protocol.lines_done
        progress.standstills.answered(self._job.lines, taken, now, protocol.line_errors)
        if not progress.unverified:
            protocol.held = False
            protocol.go(now)
        while protocol.lines_done < stop and not requests and not commands:
            output = take()
            if output:
                transport.write(output)
            wait = protocol.deadline - now
            data = read(wait if wait < POLL_S else POLL_S)
            now = now_s()
            if data:
                heard.heard_s = now
                events = feed(data, now)
                if events:
                    channel.handle(events)
                if protocol.lines_done != taken:
                    taken = protocol.lines_done
                    progress.answered(taken, now)
            if now >= protocol.deadline:
                channel.handle(protocol.tick(now))
            if now >= logbook.next_note:
                logbook.note(now)
                channel.look_around()
                stop = protocol.limit = min(stop, self._next_stop(now))
            if logbook.fault:
                self._parts.ending.end_on_fault()
            if progress.unverified:
                self._verify()
                protocol.held = False
                protocol.go(now_s())
            if killed():
                channel.await_halt()

    def _verify(self) -> None:
        """Compare positions between two lines; take back what another program has set."""
        self._parts.position.verify_in_passing()
        self._parts.meddling.take_back()

    def _measure(self, now: float) -> None:
        """Ask for what is watched and due; end the print where a reading is above its limit."""
        if now < self._parts.gauges.next_due:
            return
        self._channel.settle()
        high = self._parts.gauges.too_high(now)
        if high and not self._logbook.fault:
            self._logbook.alarm(high)
            self._parts.ending.retreat(LinkState.FAILED, high)

    def _next_stop(self, now: float) -> int:
        """Return command lines after which to look at what is due."""
        parts, done = self._parts, self._progress.done
        stop = parts.watch.next_stop(now, done, self._protocol.idle, len(self._job))
        due_s = min(parts.gauges.next_due, parts.answers.next_due, parts.clients.next_due)
        if parts.slips.due or now >= due_s:
            return done
        return parts.slips.next_stop(stop)

    # --- between two lines -----------------------------------------------------------------------

    def _obey(self) -> None:
        """Do what is asked for, with no line in flight."""
        parts = self._parts
        self._channel.settle()
        if self._progress.foreign and self._progress.unverified:
            self._verify()  # before a pause: that waits for moves that lead astray
        parts.commands.send_all(self._wiring.printing_limits)
        while (request := parts.queue.take()) is not None:
            if request is Request.STOP:
                raise StopRequested
            if request is Request.PAUSE:
                parts.pauses.pause(parts.queue.pause_words)
            elif isinstance(request, ResumeRequest):
                parts.requests.want(None)  # a pause that is waited for no longer
                request.answer("")
            elif request is Request.RELOAD:  # asked for in a pause that is over
                parts.requests.want(MarkKind.RELOAD)

    # --- finishing -------------------------------------------------------------------------------

    def _at_end(self) -> bool:
        """Whether every line was taken and every move made, and nobody minds."""
        if self._progress.done < len(self._job):
            return False
        confirmed = self._finish()
        self._parts.ending.end_on_fault()
        # a stop while the last moves were made: the way out needs the job's settings
        self._obey()
        if confirmed:
            self._parts.interruption.disarm()  # it is done, and nothing moves any more
            self._parts.firmware.undo_settings()
            self._logbook.excuse("")  # a setting that isn't taken back spoils no part
            self._parts.ending.end_on_fault()
        return confirmed

    def _finish(self) -> bool:
        """Wait for the last move; return whether the printer confirms its last line."""
        self._channel.settle()
        done, now = self._protocol.lines_done, self._wiring.clock.now()
        self._progress.standstills.answered(self._job.lines, done, now, self._protocol.line_errors)
        self._channel.command(b"M400")
        self._parts.ending.end_on_fault()  # of the last moves, or M400 was refused
        self._compared = self._parts.position.verify_end()
        self._parts.clients.compare()
        self._parts.heat.take_back()
        number = self._protocol.number
        return self._channel.agree(self._protocol.ask) == number
