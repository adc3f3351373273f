"""A printer being spoken to: one step at a time, with journal, status, wishes and kill.

Everything here runs in one thread, the one that calls `Streamer.run`. Other threads only leave a
wish (`stop`, `pause`, `resume`, `command`), which is looked at between two lines, or `kill`,
which writes to the wire at once from the thread that calls it.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

from firmware_profiles import Printer
from printctl.link import protocol as said
from printctl.link.clock import Clock
from printctl.link.errors import HandshakeError, JournalError, LinkError, PortLost
from printctl.link.firmware import Firmware
from printctl.link.job import Job
from printctl.link.journal import Journal
from printctl.link.protocol import LinkProtocol
from printctl.link.retreat import Retreat
from printctl.link.states import LinkState, Status
from printctl.link.transport import Transport

POLL_S: Final = 0.1
"""Longest wait for the printer before wishes are looked at."""
NOTE_S: Final = 0.25
"""Interval of progress records and progress events."""
KILL_REPEAT_S: Final = 0.2
KILL_ATTEMPTS: Final = 10
KILL_WAIT_S: Final = 4.0
EARLY: Final = frozenset({LinkState.CONNECTING, LinkState.CHECKING})
"""States in which the printer hasn't got the job's first line."""


class Over(Exception):  # noqa: N818
    """The print is over, in this state and for this reason."""

    def __init__(self, state: LinkState, message: str, known: bool = True, error: str = "") -> None:
        super().__init__(message)
        self.state, self.message, self.known, self.error = state, message, known, error


@dataclass(frozen=True)
class Wiring:
    """What a streamer is given.

    Attributes
    ----------
    transport : Transport
    protocol : LinkProtocol
    clock : Clock
    journal : Journal
    printer : Printer
    retreat : Retreat
    on_status : callable
        Told of every change of state and of progress every `NOTE_S`, in the streamer's thread.
    """

    transport: Transport
    protocol: LinkProtocol
    clock: Clock
    journal: Journal
    printer: Printer
    retreat: Retreat = field(default_factory=Retreat)
    on_status: Callable[[Status], None] = lambda status: None


class Channel:
    """One printer and one job.

    Parameters
    ----------
    wiring : Wiring
    job : Job
    """

    def __init__(self, wiring: Wiring, job: Job) -> None:
        self.wiring, self.job = wiring, job
        self.protocol = wiring.protocol
        self.firmware = Firmware()
        self._state, self._message = LinkState.CONNECTING, ""
        self._wishes: deque[str] = deque()
        self._commands: deque[tuple[bytes, Callable[[tuple[bytes, ...]], None]]] = deque()
        self._next_note = 0.0
        self._noted = self._checked = self._errors_seen = self._noisy_until = 0
        self._alarms = 0
        self._fault = self._slip = ""
        self._final: Status | None = None
        self._journal_lost = self._resumed = self._unverified = False
        self._replies: list[said.Replied] = []
        self._in_step: list[int] = []
        self._booted = False
        self._heard = 0
        self._kill_left = self._kill_host_s = 0.0
        self._killed = threading.Event()
        self._halted = threading.Event()
        self._ended = threading.Event()

    # --- for any thread --------------------------------------------------------------------

    def stop(self) -> None:
        """Ask for a controlled stop."""
        self._wishes.append("stop")

    def pause(self) -> None:
        """Ask for a pause."""
        self._wishes.append("pause")

    def resume(self) -> None:
        """Ask to go on after a pause."""
        self._wishes.append("resume")

    def command(self, text: bytes, done: Callable[[tuple[bytes, ...]], None]) -> None:
        """Ask for a manual command between two lines; ``done`` is told the printer's reply."""
        self._commands.append((text, done))

    def kill(self) -> None:
        """Halt the firmware at once, from any thread and any state.

        M112 goes to the wire before anything else is done. It is repeated until the printer says
        that it has halted; after `KILL_ATTEMPTS` the reset line is pulled.
        """
        if self._ended.is_set():
            return
        asked = self._kill_left = self.wiring.clock.now()
        self._killed.set()
        for attempt in range(KILL_ATTEMPTS):
            try:
                self.wiring.transport.write_urgent(self.protocol.kill_bytes)
            except PortLost:
                return
            if attempt == 0:
                self._kill_left = self.wiring.clock.now()
                self._kill_host_s = self._kill_left - asked
            if self._halted.wait(KILL_REPEAT_S):
                return
        self.wiring.transport.reset()

    @property
    def status(self) -> Status:
        """The print as it stands."""
        if self._final is not None:
            return self._final
        done = self.protocol.lines_done
        return Status(
            state=self._state,
            lines_done=done,
            lines_total=len(self.job),
            file_line=self.job.file_line(done),
            message=self._message,
            line_errors=self.protocol.line_errors,
            alarms=self._alarms,
        )

    # --- one step ----------------------------------------------------------------------------

    def _pump(self, until: float | None = None) -> None:
        """Write what is due, hear what comes, for at most `POLL_S`."""
        protocol, transport = self.protocol, self.wiring.transport
        if self._killed.is_set():
            self._await_halt()
        output = protocol.take_output()
        if output:
            transport.write(output)
        now = self.wiring.clock.now()
        due = protocol.deadline if until is None else min(protocol.deadline, until)
        data = transport.read(min(POLL_S, max(0.0, due - now)))
        now = self.wiring.clock.now()
        if data:
            self._heard += len(data)
            self._handle(protocol.feed(data, now))
        if now >= protocol.deadline:
            self._handle(protocol.tick(now))
        if now >= self._next_note:
            self._note(now)
        if self._state in EARLY and "stop" in self._wishes:
            self._stop_early()

    def _stop_early(self) -> None:
        if self._resumed:
            message = "stopped by the user before the printer was found again"
            raise Over(LinkState.FAILED, message, known=False)
        raise Over(LinkState.STOPPED, "stopped by the user before the first line")

    def _command(self, text: bytes, journalled: bool = True) -> tuple[bytes, ...]:
        """Send a control command with nothing in flight; give the printer's reply."""
        if journalled:
            number = self.protocol.number + 1
            self._record("control", n=number, command=text.decode("ascii"))
        self._replies.clear()
        self.protocol.submit(text, self.wiring.clock.now())
        while not self._replies:
            self._pump()
        return self._replies[0].lines

    def _agree(self, begin: Callable[[float], None]) -> int:
        """Renumber or ask (``begin``); give the printer's last line."""
        self._in_step.clear()
        begin(self.wiring.clock.now())
        while not self._in_step:
            self._pump()
        return self._in_step[0]

    def _await_halt(self) -> None:
        """M112 was sent by another thread: wait for the printer to say so, send nothing more."""
        clock = self.wiring.clock
        limit = clock.now() + KILL_WAIT_S
        while clock.now() < limit:
            try:
                data = self.wiring.transport.read(POLL_S)
            except PortLost:
                break
            self._handle(self.protocol.feed(data, clock.now()) if data else ())
        raise Over(
            LinkState.KILLED,
            "killed by the user; the printer has NOT confirmed: cut its power",
            known=False,
        )

    # --- events ------------------------------------------------------------------------------

    def _handle(self, events: Sequence[said.Event]) -> None:
        for event in events:
            _ON_EVENT[type(event)](self, event)

    def _on_replied(self, event: said.Replied) -> None:
        self._replies.append(event)

    def _on_in_step(self, event: said.InStep) -> None:
        self._in_step.append(event.number)

    def _on_notice(self, event: said.Notice) -> None:
        self._record("notice", text=event.text)

    def _on_went_back(self, event: said.WentBack) -> None:
        self._alarm(f"lines {event.first} to {event.last} weren't taken after all; sent again")
        self._unverified = True

    def _on_stray(self, event: said.Stray) -> None:
        self._record("notice", text=f"an ok without a line, before line {event.number}")
        self._unverified = True

    def _on_fault(self, event: said.Fault) -> None:
        where = f"line {self.job.file_line(event.line)} of {self.job.name}"
        text = f"the printer says {event.text!r} ({where})"
        self._fault = self._fault or text
        self._alarm(text)

    def _on_action(self, event: said.Action) -> None:
        wish = {"pause": "pause", "paused": "pause", "cancel": "stop", "resume": "resume"}
        if event.name in wish:
            self._alarm(f"the printer asks for {event.name!r}")
            self._wishes.append(wish[event.name])

    def _on_noisy(self, event: said.Noisy) -> None:
        self._alarm(
            f"{event.errors} line errors in {event.lines} lines; pausing: check cable and earthing"
        )
        self._wishes.append("pause")

    def _on_halted(self, event: said.Halted) -> None:
        self._halted.set()
        if self._killed.is_set():
            printer_s = self.wiring.clock.now() - self._kill_left
            raise Over(
                LinkState.KILLED,
                f"killed by the user; M112 left the host after {self._kill_host_s * 1e3:.1f} ms, "
                f"the printer halted {printer_s * 1e3:.0f} ms later",
                known=False,
            )
        because = f": {self._fault}" if self._fault else ""
        raise Over(LinkState.KILLED, f"the firmware halted itself ({event.text}){because}", False)

    def _on_booted(self, event: said.Booted) -> None:
        self._booted = True
        if self._killed.is_set():
            raise Over(LinkState.KILLED, "killed by the user, by the reset line", known=False)

    def _on_reset(self, event: said.WasReset) -> None:
        self._on_booted(said.Booted())
        if self._state in EARLY and not self._resumed:
            raise HandshakeError(
                f"the printer at {self.wiring.transport.name} was reset during the handshake; "
                "check its power and cable, and try again"
            )
        raise Over(
            LinkState.POSITION_UNKNOWN,
            f"the printer was reset after {self._progress()}; `printctl recover` goes on",
            known=False,
        )

    def _on_out_of_step(self, event: said.OutOfStep) -> None:
        raise Over(
            LinkState.POSITION_UNKNOWN,
            f"the printer's last line is {event.last}, the host's {event.expected}; another "
            "program may have spoken to it; `printctl recover` tells how to go on",
            known=False,
        )

    def _on_silent(self, event: said.Silent) -> None:
        if self._state in EARLY:
            raise HandshakeError(
                f"no firmware answers at {self.wiring.transport.name} "
                f"({self._heard} bytes heard in {event.seconds:.0f} s); check that the printer is "
                f"on, its baud rate (profile: {self.wiring.printer.baud}) and its firmware "
                f"(profile: {self.wiring.printer.firmware})"
            )
        raise Over(
            LinkState.FAILED,
            f"the printer gave no usable answer for {event.seconds:.0f} s after "
            f"{self._progress()}; the next line may or may not have been taken",
            known=False,
        )

    # --- state, journal ------------------------------------------------------------------------

    def _progress(self) -> str:
        done = self.protocol.lines_done
        file_line = self.job.file_line(done)
        return f"{done} of {len(self.job)} lines were acknowledged (line {file_line} of the file)"

    def _broken(self, exc: LinkError) -> Over:
        name = type(exc).__name__
        if self._killed.is_set():
            return Over(LinkState.KILLED, f"killed by the user; {exc}", False, name)
        if isinstance(exc, PortLost):
            message = f"{exc}; {self._progress()}, the next may have been taken; position unknown"
            return Over(LinkState.FAILED, message, False, name)
        known = isinstance(exc, HandshakeError) and not self._resumed
        return Over(LinkState.FAILED, str(exc), known, name)

    def _enter(self, state: LinkState, message: str) -> None:
        self._note(self.wiring.clock.now())
        self._state, self._message = state, message
        self._record("state", state=state, message=message)
        self.wiring.on_status(self.status)

    def _note(self, now: float) -> None:
        """Write down progress and tell the clients."""
        self._next_note = now + NOTE_S
        done = self.protocol.lines_done
        if done != self._noted:
            self._record("ack" if done > self._noted else "back", done=done)
            self._noted = done
            self.wiring.on_status(self.status)

    def _record(self, sort: str, **values: Any) -> None:
        """Add to the journal; a full disk is a fault that ends the print by a controlled stop."""
        if self._journal_lost:
            return
        try:
            self.wiring.journal.add(sort, **values)
        except JournalError as exc:
            self._journal_lost, self._fault = True, str(exc)

    def _alarm(self, text: str) -> None:
        self._alarms += 1
        self._record("alarm", text=text)

    def _record_end(self, over: Over) -> Status:
        # Whoever asks meanwhile must see the print either running or ended with all that is known.
        status = replace(
            self.status,
            state=over.state,
            message=over.message,
            position_known=over.known,
            error=over.error,
        )
        self._state, self._final = over.state, status
        self._record(
            "end",
            state=status.state,
            message=status.message,
            done=status.lines_done,
            error=over.error,
            position_known=over.known,
        )
        return status


_ON_EVENT: Final[dict[type, Callable[[Channel, Any], None]]] = {
    said.Replied: Channel._on_replied,
    said.InStep: Channel._on_in_step,
    said.Fault: Channel._on_fault,
    said.Notice: Channel._on_notice,
    said.WentBack: Channel._on_went_back,
    said.Stray: Channel._on_stray,
    said.Action: Channel._on_action,
    said.Noisy: Channel._on_noisy,
    said.Halted: Channel._on_halted,
    said.Booted: Channel._on_booted,
    said.WasReset: Channel._on_reset,
    said.OutOfStep: Channel._on_out_of_step,
    said.Silent: Channel._on_silent,
}
