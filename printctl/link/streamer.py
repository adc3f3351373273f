"""Streams a job to a printer: the sequence of a print, from handshake to end.

The states are in ``docs/link.md``; how one step is done, and what other threads may call, in
`printctl.link.channel`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from printctl.link.channel import POLL_S, Channel, Over, Wiring
from printctl.link.errors import HandshakeError, LinkError
from printctl.link.families import family_of
from printctl.link.firmware import differences, parse_firmware
from printctl.link.journal import History
from printctl.link.modal import Modal, disagreement, modal_state, parse_position
from printctl.link.retreat import heaters_off
from printctl.link.states import LinkState, Status

__all__ = ["Streamer", "Wiring"]

BOOT_LISTEN_S: Final = 1.0
BOOT_QUIET_S: Final = 0.5
BOOT_LIMIT_S: Final = 10.0
CONNECT_LIMIT_S: Final = 15.0
RETRIES: Final = 8
CHECK_LINES: Final = 100
"""On a line that makes errors, the position is compared after so many lines: a word garbled past
the checksum (X to Z) stays wrong until a later line gives it again."""
PAUSE_SIGN_S: Final = 20.0
"""Interval of M105 in a pause: it shows that the printer is there and restarts M85's timer."""


class Streamer(Channel):
    """One print; see `Channel` for what it is given."""

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
            self._agree(self.protocol.renumber)
            self.protocol.load(self.job.lines, 0, 0)
        else:
            self._find_again(history)
        self._enter(LinkState.PRINTING, f"printing {self.job.name}")
        while self.protocol.lines_done < len(self.job):
            self._stream()
            self._obey()
            if self.protocol.lines_done == len(self.job):
                self._finish()
                self._obey()  # a stop while the last moves were made
        raise Over(LinkState.DONE, f"all {len(self.job)} lines done")

    def _stream(self) -> None:
        """Send lines until the job is at its end or somebody wishes something.

        This loop is the hot path of the link: one write, one poll and one read a line.
        """
        protocol, transport = self.protocol, self.wiring.transport
        now_s, read, take = self.wiring.clock.now, transport.read, protocol.take_output
        feed, wishes, commands, total = protocol.feed, self._wishes, self._commands, len(self.job)
        now = now_s()
        if not self._unverified:
            protocol.held = False
            protocol.go(now)
        while protocol.lines_done < total and not wishes and not commands:
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
                self._doubt_a_noisy_line()
            if self._fault:
                self._settle()
                self._retreat_and_end(LinkState.FAILED, self._fault)
            if self._unverified:
                self._verify_in_passing()
            if self._killed.is_set():
                self._await_halt()

    def _doubt_a_noisy_line(self) -> None:
        """Have the position compared where lines were sent again since it last was."""
        errors, done = self.protocol.line_errors, self.protocol.lines_done
        if errors != self._errors_seen and done - self._checked >= CHECK_LINES:
            self._errors_seen, self._checked, self._unverified = errors, done, True

    def _verify_in_passing(self) -> None:
        """Compare positions between two lines; the planner isn't drained for it."""
        self._settle()
        self._unverified = False
        self._verify(modal_state(self.job.lines, self.protocol.lines_done))
        self.protocol.held = False
        self.protocol.go(self.wiring.clock.now())

    def _obey(self) -> None:
        """Do what was wished, with no line in flight."""
        self._settle()
        while self._commands:
            text, done = self._commands.popleft()
            done(self._command(text))
        while self._wishes:
            wish = self._wishes.popleft()
            if wish == "stop":
                self._retreat_and_end(LinkState.STOPPED, "stopped by the user")
            elif wish == "pause":
                self._pause()

    # --- connecting ------------------------------------------------------------------------

    def _connect(self) -> None:
        if self.wiring.printer.resets_on_connect:
            self._await_boot()
        limit = self.wiring.clock.now() + CONNECT_LIMIT_S
        while True:
            try:
                self._agree(self.protocol.renumber)
            except HandshakeError:  # some boards sit in their boot loader for long
                if self.wiring.clock.now() > limit:
                    raise
            else:
                return

    def _await_boot(self) -> None:
        """Give a board that resets when the port opens the time to say so, and to wake up."""
        clock = self.wiring.clock
        listen_until = clock.now() + BOOT_LISTEN_S
        while clock.now() < listen_until and not self._booted:
            self._pump(listen_until)
        limit, heard = clock.now() + BOOT_LIMIT_S, -1
        while self._booted and heard != self._heard and clock.now() < limit:
            heard = self._heard
            until = clock.now() + BOOT_QUIET_S
            while clock.now() < until:
                self._pump(until)

    def _check(self) -> None:
        family = family_of(self.wiring.printer)
        for _ in range(RETRIES):
            self.firmware = parse_firmware(self._command(b"M115", journalled=False))
            if self.firmware.is_a(family.says):
                break
        else:
            name = self.firmware.name or "nothing"
            raise HandshakeError(
                f"{self.wiring.transport.name} answers M115 with {name!r}, the profile expects "
                f"{self.wiring.printer.firmware}; choose the profile of this printer"
            )
        self._check_keepalive(journalled=False)
        if family.tells_steps:
            self._check_steps()
        else:
            self._record("notice", text="this firmware doesn't tell its steps per mm (M92)")
        for mode in (b"G21", b"G90", b"M82"):  # what an earlier job may have left otherwise
            self._command(mode, journalled=False)
        if not self._journal_lost:
            self._fault = ""  # a firmware without M113 says so; that is no fault of the job

    def _check_keepalive(self, journalled: bool) -> None:
        """Have the firmware say every second that it is busy, and see that it will."""
        if not family_of(self.wiring.printer).keepalive:
            self.protocol.keepalive = False
            return
        for _ in range(RETRIES):
            self._command(b"M113 S1", journalled)
            if any(b"M113 S1" in text for text in self._command(b"M113", journalled)):
                return
        self.protocol.keepalive = False
        self._alarm("the firmware sends no busy messages (M113); a lost ok costs a minute")

    def _check_steps(self) -> None:
        """Refuse a printer whose steps per mm aren't the profile's; note other differences."""
        found: list[str] = []
        for _ in range(RETRIES):
            steps = self._command(b"M92", journalled=False)
            found = differences(self.firmware, steps, self.wiring.printer)
            if not any("steps/mm" in text for text in found):
                break
        for text in found:
            if "steps/mm" in text:
                raise HandshakeError(
                    f"{text}: distances or doses would be wrong; set the firmware (M92, M500) or "
                    "correct the profile"
                )
            self._alarm(text)

    def _find_again(self, history: History) -> None:
        """Ask a printer in mid-job for its last line, and go on from there if all agrees."""
        self._resumed = True
        if not family_of(self.wiring.printer).remembers:
            raise Over(
                LinkState.POSITION_UNKNOWN,
                f"{self.wiring.printer.firmware} can't tell which line it took last; at least "
                f"{history.done} job lines were taken; home the printer and print anew",
                known=False,
            )
        number = self._agree(self.protocol.ask)
        done = history.job_line(number)
        reset = self._booted or (number == 0 and history.done > 0)
        if reset or not history.done <= done <= len(self.job):
            raise Over(
                LinkState.POSITION_UNKNOWN,
                f"the printer's last line is {number}, the journal knows of {history.done} job "
                "lines: it was reset or used by another program since; home it and print anew",
                known=False,
            )
        self.protocol.load(self.job.lines, done, number)
        self._record("ack", done=done)
        self._check_keepalive(journalled=True)
        self._command(b"M400")
        at = self._where()
        self._verify(replace(at, z=None, e=None))  # a pause may have lifted and relieved
        for command in self.wiring.retreat.rejoin(at, self.wiring.printer):
            self._command(command)
        self._command(b"M400")
        self._verify(at)

    # --- pausing, stopping, finishing --------------------------------------------------------

    def _settle(self) -> None:
        """Send no further job line; wait until the one in flight is taken."""
        self.protocol.held = True
        while not self.protocol.idle:
            self._pump()

    def _pause(self) -> None:
        self._enter(LinkState.PAUSING, "relieving the plunger and lifting the needle")
        self._command(b"M400")
        at = self._where()
        self._verify(at)
        for command in self.wiring.retreat.leave(at, self.wiring.printer):
            self._command(command)
        self._command(b"M400")
        self._enter(LinkState.PAUSED, "paused")
        self._stay_paused()
        self._enter(LinkState.RESUMING, "returning to where the print was left")
        for command in self.wiring.retreat.rejoin(at, self.wiring.printer):
            self._command(command)
        self._command(b"M400")
        self._verify(at)
        self._enter(LinkState.PRINTING, "printing")

    def _stay_paused(self) -> None:
        clock = self.wiring.clock
        while True:
            until = clock.now() + PAUSE_SIGN_S
            while clock.now() < until and not self._wishes and not self._commands:
                self._pump(until)
            while self._commands:
                text, done = self._commands.popleft()
                done(self._command(text))
            wish = self._wishes.popleft() if self._wishes else ""
            if wish == "resume":
                return
            if wish == "stop":
                self._heaters_off()
                raise Over(LinkState.STOPPED, "stopped by the user while paused")
            self._command(b"M105")

    def _where(self) -> Modal:
        """Where the job's text says the printer is; what it doesn't say is asked for."""
        at = modal_state(self.job.lines, self.protocol.lines_done)
        if at.z is None or at.e is None:
            position = parse_position(self._command(b"M114"))
            at = replace(
                at,
                z=position.get("Z") if at.z is None else at.z,
                e=position.get("E") if at.e is None else at.e,
            )
        return at

    def _verify(self, at: Modal) -> None:
        """Compare the printer's position with the job's text; write both down."""
        wrong = "its position can't be read (M114)"
        position: dict[str, float] = {}
        for _ in range(RETRIES):  # a reply may be garbled, where a line can't be
            position = parse_position(self._command(b"M114")) or position
            wrong = disagreement(at, position) if position else wrong
            if position and not wrong:
                break
        done = self.protocol.lines_done
        self._record("checkpoint", done=done, position=position, agrees=not wrong)
        if wrong:
            raise Over(
                LinkState.POSITION_UNKNOWN,
                f"after line {done}: {wrong}; home the printer and print anew",
                known=False,
            )

    def _retreat_and_end(self, state: LinkState, message: str) -> None:
        self._enter(LinkState.STOPPING, message)
        self._fault = ""
        for command in self.wiring.retreat.leave(self._where(), self.wiring.printer):
            self._command(command)
        self._heaters_off()
        self._command(b"M400")
        raise Over(state, message)

    def _heaters_off(self) -> None:
        for command in heaters_off(self.wiring.printer):
            self._command(command)

    def _finish(self) -> None:
        """Wait for the last move, and have the printer confirm its last line."""
        self._settle()
        self._command(b"M400")
        self._agree(self.protocol.ask)
