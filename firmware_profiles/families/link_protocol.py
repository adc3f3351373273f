"""Interface of a printer's serial protocol: received bytes in; events, bytes to send out; no I/O.

A protocol is a state machine. It is told what the printer said (`feed`) and what time it is, and
answers with events; what must be written is collected in `take_output`; `deadline` says when it
wants to be woken (`tick`) if nothing is said until then. It opens nothing, waits for nothing and
reads no clock, so that fifty noisy prints run in seconds and every case is tested by transcript.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias


@dataclass(frozen=True)
class CommandReplied:
    """A control command was taken and answered.

    Attributes
    ----------
    command : bytes
    number : int
        Line number that it was sent under.
    lines : tuple of bytes
        What the printer said before its ok (and after ok on the same line).
    """

    command: bytes
    number: int
    lines: tuple[bytes, ...]


@dataclass(frozen=True)
class Synchronised:
    """Renumbering or asking has succeeded: the printer last took line ``number``."""

    number: int


@dataclass(frozen=True)
class Fault:
    """The printer says that it didn't do what it was told, though it may say ok as well.

    Attributes
    ----------
    text : str
        Its own words.
    line : int
        Job lines taken, the one in flight at the time included.
    refused : bool
        Whether it answers that line, which wasn't carried out as it is written.
    about_command : bool
        Whether it says of a command alone that it isn't known or can't be carried out. Of a
        question, or of what a person typed, that is an answer.
    """

    text: str
    line: int
    refused: bool = False
    about_command: bool = False


@dataclass(frozen=True)
class Notice:
    """Something for the journal that needs no action: a lost ok, a resent line, a stray reply."""

    text: str


@dataclass(frozen=True)
class Remark:
    """The printer said what somebody should know of, or what no table of its family has.

    Attributes
    ----------
    text : str
        Its own words.
    known : bool
        Whether its family's table has it.
    """

    text: str
    known: bool = False


@dataclass(frozen=True)
class LinesResent:
    """Lines that an ok which wasn't theirs had acknowledged are sent again.

    Something that nobody sent has been answered, so it may have been done: the protocol holds the
    job (``held``) until the position has been verified.

    Attributes
    ----------
    first, last : int
        Their numbers.
    controls : tuple of bytes
        Control commands that go (again) before any job line, under the numbers from ``first`` on.
    """

    first: int
    last: int
    controls: tuple[bytes, ...] = ()


@dataclass(frozen=True)
class StrayOk:
    """An ok that belongs to no line: a fragment of a garbled one may have been done unverified.

    The protocol holds the job (``held``) until the position has been verified.

    Attributes
    ----------
    number : int
        Of the line near which it came.
    foreign : int
        So many more answers than lines, on a wire that made no error: something else than the host
        wrote to the printer. 0 where noise may explain them.
    line : int
        Line of the job, one-based, that may have been run twice: an error may have cut off the
        number of the second of two in flight. 0 for none.
    """

    number: int
    foreign: int = 0
    line: int = 0


@dataclass(frozen=True)
class TokenSent:
    """A line of the protocol's own is about to leave: its number must be in the journal before.

    Attributes
    ----------
    number : int
    command : bytes
    """

    number: int
    command: bytes


@dataclass(frozen=True)
class Waiting:
    """The printer gives no usable answer; it is asked on until the limit.

    Attributes
    ----------
    seconds, limit : float, s
        So far, and when it counts as silent.
    """

    seconds: float
    limit: float


@dataclass(frozen=True)
class WaitingForPerson:
    """The printer waits for a person at its own button (``paused for user``)."""


@dataclass(frozen=True)
class Action:
    """The printer asks its host for an action (``//action:pause``)."""

    name: str


@dataclass(frozen=True)
class Noisy:
    """The line makes more errors than the limit; the print should pause.

    Attributes
    ----------
    errors, lines : int
        Lines sent again, among so many.
    """

    errors: int
    lines: int


@dataclass(frozen=True)
class LineRefused:
    """The same line was refused `MAX_REFUSALS` times in turn; the protocol is over.

    Attributes
    ----------
    number, times : int
        The line's number, and how often it was sent again.
    command : str
    line : int
        Which of the job's it is, one-based; 0 for a control command.
    text : str
        The printer's own words; empty where it said nothing.
    """

    number: int
    times: int
    command: str
    line: int
    text: str = ""


@dataclass(frozen=True)
class Halting:
    """Firmware has reported a final stop and is asked for the reason; `FirmwareHalted` follows."""

    text: str


@dataclass(frozen=True)
class FirmwareHalted:
    """The firmware has stopped for good (``kill``); only a reset brings it back."""

    text: str


@dataclass(frozen=True)
class FirmwareStarted:
    """The firmware has started, before anything was agreed on with it."""


@dataclass(frozen=True)
class FirmwareReset:
    """The firmware has started anew after its lines were numbered; the protocol is over.

    It no longer knows where its needle is.
    """


@dataclass(frozen=True)
class Renumbered:
    """The printer's count of lines isn't the host's, though no line was lost; it is set back.

    The protocol holds the job (``held``) until the position has been verified.

    Attributes
    ----------
    last, expected : int
        As for `LostSynchronisation`.
    """

    last: int
    expected: int


@dataclass(frozen=True)
class LostSynchronisation:
    """The printer's last line is none that the host can go on from.

    Attributes
    ----------
    last, expected : int
        What the printer says, confirmed, and what the host has acknowledged.
    """

    last: int
    expected: int


@dataclass(frozen=True)
class NoReply:
    """No usable answer within all time limits."""

    seconds: float


Event: TypeAlias = (
    CommandReplied
    | Synchronised
    | Fault
    | Notice
    | Remark
    | LinesResent
    | StrayOk
    | TokenSent
    | Waiting
    | WaitingForPerson
    | Action
    | Noisy
    | LineRefused
    | Halting
    | FirmwareHalted
    | FirmwareStarted
    | FirmwareReset
    | Renumbered
    | LostSynchronisation
    | NoReply
)
Places: TypeAlias = Callable[[Sequence[bytes], int], Mapping[str, float]]
"""Coordinates last commanded in so many job lines: X, Y, Z and E, mm; without those never named."""


class LinkProtocol(Protocol):
    """What the streamer needs of a firmware family.

    Attributes
    ----------
    held : bool
        While set, no further job line is sent; control commands are.
    limit : int
        Job lines that may be sent; `load` sets it to all of them.
    keepalive : bool
        Whether the firmware says once a second that it is busy; set once that is known.
    kill_bytes : bytes
        What halts the firmware at once, out of band.
    """

    held: bool
    limit: int
    keepalive: bool
    kill_bytes: bytes

    @property
    def deadline(self) -> float:
        """When `tick` is due, s; infinite for never."""
        ...

    @property
    def lines_done(self) -> int:
        """Job lines known to be taken."""
        ...

    @property
    def number(self) -> int:
        """Line number known to be taken last, control commands included."""
        ...

    @property
    def report(self) -> bytes:
        """Temperatures, or for whom it waits, as told last in a line of its own; else empty."""
        ...

    @property
    def line_errors(self) -> int:
        """Lines sent again so far."""
        ...

    @property
    def idle(self) -> bool:
        """Nothing is in flight and nothing is being asked."""
        ...

    def load(self, lines: Sequence[bytes], first: int, number: int) -> None:
        """Take a job; go on at line ``first``, the printer's last line being ``number``."""
        ...

    def grow(self, lines: Sequence[bytes]) -> None:
        """Take a job that has got lines behind those that were taken; nothing may be in flight."""
        ...

    def renumber(self, now: float) -> None:
        """Set the printer's last line to 0; `Synchronised` follows, or an error event."""
        ...

    def ask(self, now: float) -> None:
        """Ask which line was taken last; `Synchronised` follows, or an error event."""
        ...

    def confirm(self, now: float) -> None:
        """Have the printer say what it can say only once all before is carried out.

        `Synchronised` follows, or an error event. Nothing may be in flight.
        """
        ...

    def submit(self, command: bytes, now: float) -> None:
        """Send a control command ahead of further job lines; `CommandReplied` follows."""
        ...

    def cut_in(self, commands: Sequence[bytes], again: bool, now: float) -> bool:
        """Write commands past the line in flight, without numbers; each earns an ok of its own.

        Parameters
        ----------
        commands : sequence of bytes
            Without any the printer is asked at once whether it hears.
        again : bool
            Whether the last is written once more behind each move that is in flight, as soon as
            that was taken.
        now : float, s

        Returns
        -------
        bool
            Whether they were written; not with nothing in flight, nor where the family can't tell
            their oks from others, nor behind a line that they would spoil.
        """
        ...

    def go(self, now: float) -> None:
        """Send the next line if nothing is in flight."""
        ...

    def feed(self, data: bytes, now: float) -> Sequence[Event]:
        """Take what the printer said."""
        ...

    def tick(self, now: float) -> Sequence[Event]:
        """Take notice that it is ``now`` and nothing has come."""
        ...

    def take_output(self) -> bytes:
        """Give what must be written now, and forget it."""
        ...
