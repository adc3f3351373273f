"""Interface of a printer's serial protocol: received bytes in; events, bytes to send out; no I/O.

A protocol is a state machine. It is told what the printer said (`feed`) and what time it is, and
answers with events; what must be written is collected in `take_output`; `deadline` says when it
wants to be woken (`tick`) if nothing is said until then. It opens nothing, waits for nothing and
reads no clock, so that fifty noisy prints run in seconds and every case is tested by transcript.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Protocol, TypeAlias


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


# Time limits of a printer link's protocol, and the number of transmission errors it tolerates.

HOST_LATE_S: Final = 1.0
"""A deadline missed by more: the host slept, which is no silence of the printer."""


@dataclass(frozen=True)
class Timing:
    """Time limits and the limit on line errors.

    Attributes
    ----------
    silence_s : float
        Without any sign of life while a line is in flight, until the printer is asked. It decides
        nothing but how soon a lost ok is noticed.
    deaf_s : float
        Of a firmware that says nothing while it is busy: after so long, and then as often, a notice
        is given and it is asked.
    quiet_s : float
        Of silence that counts as "no reply is under way"; longer than a USB adapter's latency.
    whole_s : float
        For the second half of a line from the printer, before it is asked for a token.
    answer_s : float
        For the answer to a question, until it is asked again.
    doubt_limit_s : float
        Without a usable answer until a printer that isn't found yet counts as silent, and until
        an alarm is given of one in mid-print. An answer that is later than this was lost.
    silent_limit_s : float
        Without a usable answer until a printer in mid-print counts as silent.
    busy_limit_s : float
        For one line of a firmware that says nothing while it is busy.
    noise_window, noise_limit : int
        More than ``noise_limit`` lines sent again among ``noise_window``: the print pauses.
    calm_lines : int
        After a doubt so many lines leave one by one, where two may be in flight.
    """

    silence_s: float = 1.8
    deaf_s: float = 60.0
    quiet_s: float = 0.05
    whole_s: float = 0.2
    answer_s: float = 0.8
    doubt_limit_s: float = 6.0
    silent_limit_s: float = 60.0
    busy_limit_s: float = 1800.0
    noise_window: int = 500
    noise_limit: int = 30
    calm_lines: int = 200


MAX_REFUSALS: Final = 100
"""Times in turn that one line is sent again. Noise that garbles nine of ten lines does that to one
in 40,000, and the print has paused long before; Marlin takes half a second for each."""


@dataclass
class LineErrors:
    """Count of resent lines and their rate.

    Attributes
    ----------
    window, limit : int
        More than ``limit`` among ``window`` lines is too many.
    total : int
        Since the start.
    in_turn : int
        Of the line that was sent again last, with no other in between.
    """

    window: int
    limit: int
    total: int = 0
    in_turn: int = 0
    _newest: int = -1
    _start: int = 0
    _here: int = 0

    def count(self, number: int) -> Noisy | None:
        """Take notice that line ``number`` + 1 is sent again; `Noisy` when the limit is passed."""
        self.total += 1
        self.in_turn = self.in_turn + 1 if number == self._newest else 1
        self._newest = number
        if number - self._start > self.window or number < self._start:
            self._start, self._here = number, 0
        self._here += 1
        if self._here <= self.limit:
            return None
        noisy = Noisy(self._here, number - self._start)
        self._start, self._here = number, 0
        return noisy

    @property
    def stuck(self) -> bool:
        """Whether one line was sent again so often that it never will be taken."""
        return self.in_turn >= MAX_REFUSALS


QUESTION: Final = b"\nN99999999 M105*23\n"
"""A line with a number far too high: families that count lines refuse it, others tell their
temperatures. It starts with a line end, to end what noise may have left open. Any tail of it that
survives a flush reads M105 or an unknown command, both harmless."""
