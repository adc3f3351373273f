"""Where a print stands: its state, what its clients are told of it, and what its journal gets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Final

from firmware_profiles import Printer
from firmware_profiles.families.link_protocol import LinkProtocol
from printctl.gate import Bounds, Known
from printctl.link.clock import Clock
from printctl.link.errors import JournalError
from printctl.link.job import Job
from printctl.link.journal import Journal
from printctl.link.made import Made
from printctl.link.retreat import Retreat
from printctl.link.states import LinkState, Status
from printctl.link.transport import Transport

NOTE_S: Final = 0.25
"""Interval of progress records and progress events."""


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
    fresh : bool
        Whether the port has just been opened, so that the board may be starting.
    on_status : callable
        Told of every change of state and of progress every `NOTE_S`, in the streamer's thread.
    room : callable or None
        What a station knows of the room around the tip, and of heat.
    """

    transport: Transport
    protocol: LinkProtocol
    clock: Clock
    journal: Journal
    printer: Printer
    retreat: Retreat = field(default_factory=Retreat)
    fresh: bool = True
    on_status: Callable[[Status], None] = lambda status: None
    room: Callable[[], Known] | None = None

    def limits(self) -> Known:
        """What the gate judges by: a station's knowledge, or the profile alone."""
        return self.room() if self.room is not None else Known(Bounds(self.printer))


class Logbook:
    """State of one print, told and written down.

    Parameters
    ----------
    wiring : Wiring
    job : Job
    """

    def __init__(self, wiring: Wiring, job: Job) -> None:
        self.wiring, self.job = wiring, job
        self.protocol = wiring.protocol
        self._made = Made(job.lines, wiring.printer)
        self._state, self._message = LinkState.CONNECTING, ""
        self._next_note = 0.0
        self._noted = self._alarms = 0
        self._fault = ""
        self._final: Status | None = None
        self._journal_lost = False

    @property
    def status(self) -> Status:
        """The print as it stands."""
        if self._final is not None:
            return self._final
        done = self.protocol.lines_done
        return Status(
            state=self._state,
            lines_done=done,
            lines_executed=self._made.after(done),
            lines_total=len(self.job),
            file_line=self.job.file_line(done),
            message=self._message,
            line_errors=self.protocol.line_errors,
            alarms=self._alarms,
        )

    def _progress(self) -> str:
        done = self.protocol.lines_done
        file_line = self.job.file_line(done)
        return f"{done} of {len(self.job)} lines were acknowledged (line {file_line} of the file)"

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
        self._journal_lost = False  # there may be room again, and this is the one that matters
        self._record(
            "end",
            state=status.state,
            message=status.message,
            done=status.lines_done,
            error=over.error,
            position_known=over.known,
        )
        return status
