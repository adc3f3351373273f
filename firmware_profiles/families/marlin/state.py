"""State of Marlin's line protocol: lines sent, lines acknowledged, lines in doubt."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Final

from firmware_profiles.families import timing
from firmware_profiles.families.link_protocol import Event, Fault, LineRefused
from firmware_profiles.families.marlin.replies import ORDER_ERROR, Kind, Reply, Tokens, frame
from firmware_profiles.families.pairing import Pairing
from firmware_profiles.families.timing import LineErrors, Timing

_RECALLED: Final = 4
"""Lines behind which an unknown-command reply may come late: as many as a command queue holds."""


class Phase(Enum):
    """Phase of resolving a doubt."""

    READY = auto()
    FLIGHT = auto()
    DRAIN = auto()
    ASK = auto()
    SETTLE = auto()
    OVER = auto()


RENUMBER: Final = b"\n" + frame(0, b"M110 N0")


class QueryGoal(Enum):
    """What a question is asked for."""

    GO_ON = auto()
    NUMBER = auto()
    RENUMBER = auto()
    SET_BACK = auto()
    """The printer's count is set to the host's, which another program has changed."""


class Questions:
    """Questions whose answers haven't come; they come in turn, or were lost.

    All answers within one doubt say the same, as no line leaves between its questions. One to a
    question of an earlier doubt says what was true then: it is passed over.

    Parameters
    ----------
    lost_s : float
        Without its answer for so long, a question or its answer was lost.
    """

    def __init__(self, lost_s: float) -> None:
        self._lost_s = lost_s
        self._asked_s: deque[float] = deque()
        self._late = self._late_ok = False

    def ask(self, now: float) -> None:
        """Record that one was asked."""
        self._asked_s.append(now)

    def forget(self, until_s: float) -> None:
        """Forget those asked before ``until_s``: what was sent then has come back."""
        while self._asked_s and self._asked_s[0] < until_s:
            self._asked_s.popleft()
        self._late = self._late_ok = False

    def answered_late(self, reply: Reply, now: float, began_s: float) -> bool:
        """Whether a line belongs to the answer to a question of before ``began_s``."""
        kind = reply.kind
        if kind is Kind.OK:
            late, self._late_ok = self._late_ok, False
            return late
        if kind is Kind.ERROR and ORDER_ERROR in reply.text:
            while self._asked_s and self._asked_s[0] < now - self._lost_s:
                self._asked_s.popleft()
            self._late = bool(self._asked_s) and self._asked_s[0] < began_s
            if self._asked_s:
                self._asked_s.popleft()
            return self._late
        late = kind is Kind.RESEND and self._late
        if late:
            self._late, self._late_ok = False, True
        return late


@dataclass
class DoubtEvidence:
    """What was heard since the doubt began.

    Attributes
    ----------
    since : float
        When it began, or the printer last said that it is busy, s.
    began_s : float, s
        When it began.
    number : int
        Of the (first) line in flight.
    flights : tuple of (bytes or None)
        The command in flight, or two.
    asked : bool
        Whether a question was asked.
    alarmed : bool
        Whether it was said that no usable answer comes.
    last, resend : int
        The answer to the last question: ``Last Line`` and ``Resend``; -1 until heard.
    confirmed : int
        An unexpected last line that was heard once already.
    oks : int
        That belong to no ``Resend`` and no unknown command of a stray fragment.
    quoted : bytes
        The command in an unknown-command echo.
    """

    since: float
    began_s: float = 0.0
    number: int = 0
    flights: tuple[bytes | None, ...] = (None,)
    asked: bool = False
    alarmed: bool = False
    last: int = -1
    resend: int = -1
    confirmed: int = -1
    oks: int = 0
    quoted: bytes = b""
    _foreign_ok: bool = False

    @property
    def answered(self) -> bool:
        """Whether both halves of an answer are there."""
        return self.last >= 0 and self.resend >= 0

    @property
    def agreed(self) -> bool:
        """Whether they say the same."""
        return self.last >= 0 and self.resend == self.last + 1

    def ask_again(self) -> None:
        """Forget the last answer; what it said of the ok to come, too."""
        self.asked = True
        self.last = self.resend = -1
        self._foreign_ok = False

    def hear(self, reply: Reply) -> None:
        """Take one more line into account."""
        kind = reply.kind
        if kind is Kind.OK:
            self._hear_ok(reply)
        elif kind is Kind.RESEND:
            self.resend, self._foreign_ok = reply.number, True
        elif kind is Kind.ERROR and ORDER_ERROR in reply.text:
            self.last = reply.number
        elif kind is Kind.UNKNOWN_COMMAND:
            self.quoted = reply.command
            self._foreign_ok = self.quoted not in self.flights

    def _hear_ok(self, reply: Reply) -> None:
        if self._foreign_ok:
            self._foreign_ok = False
        elif reply.number < 0:
            self.oks += 1
        elif 0 <= (before := reply.number - self.number) < len(self.flights):
            self.oks = max(self.oks, before + 1)


@dataclass(eq=False, slots=True)
class LineState:
    """Shared by the parts of one protocol.

    Attributes
    ----------
    timing : Timing
    pairing : Pairing or None
    errors : LineErrors
    tokens : Tokens
    questions : Questions
    deadline, lines_done, number, held, limit, keepalive, report
        As `LinkProtocol`'s.
    lines : sequence of bytes
        The job's.
    phase : Phase
    numbered : bool
        Whether the printer's lines were numbered, so that a start is a reset.
    alone_until : int
        Up to this number lines leave one by one.
    controls : deque of bytes
        Control commands that wait.
    control_numbers : dict of int to bytes
        Those that were taken, by number.
    flight, flight_frame : bytes or None, bytes
        What is in flight, and as it is sent.
    flight_control : bool
        Whether it is a control command, or a token.
    behind_job : bool
        Whether the line that left last is the job's.
    second, second_frame : bytes or None, bytes
        In flight behind it.
    withheld : bytes
        End of the second's frame that hasn't left yet; without it the printer refuses the line.
    cut : int
        Job line, one-based, that was the second in flight when the last doubt of a pair began: an
        error may have cut off its number, so that it was run unchecked. 0 for none.
    refusing : bool
        Whether the second is to be refused, not run: an error came that answers a line before it.
    awaiting : (int, bytes) or None
        A control command that was taken; its answer is still to come.
    faulty : bool
        Whether the printer has complained since the job was last let go.
    fast : bool
        Whether a plain ok needs no thought.
    waits : bool
        Whether nothing new leaves until the rest of a read is heard, or the rest of a line that the
        read has cut: an error is in it or may be.
    rest : bytes
        Heard, without its line end so far.
    out, said : list of bytes
        To be written; heard of the line in flight.
    complaint : str
        What the firmware said last of why it halts, if it does.
    goal, doubt : QueryGoal, DoubtEvidence
        What is asked, and what was heard of it.
    confirming : bool
        Whether a token was asked for by `LinkProtocol.confirm`.
    names_lines : bool
        Whether an ok has named its line (ADVANCED_OK): then each of the host's lines is named.
    misnamed, misnamed_line, times_misnamed : int, int, int
        Number that an ok has named in place of the line in flight's; that line; for how many lines
        running it was the same number.
    plain : bool
        Whether ADVANCED_OK is read as a plain ok: its numbers don't follow the lines.
    told_odd : bool
        Whether it was told that ADVANCED_OK's fields make no sense.
    set_backs : int
        Times running that the printer's count of lines was set back.
    refusal : str
        What the printer said last to a line that it may not have taken; empty for nothing.
    behind_moves : bytes
        Written behind each move in flight that is taken, after `LinkProtocol.cut_in`.
    """

    timing: Timing
    pairing: Pairing | None
    errors: LineErrors
    tokens: Tokens
    questions: Questions
    deadline: float = math.inf
    lines_done: int = 0
    number: int = 0
    held: bool = True
    limit: int = 0
    keepalive: bool = True
    report: bytes = b""
    lines: Sequence[bytes] = ()
    phase: Phase = Phase.READY
    numbered: bool = False
    alone_until: int = 0
    controls: deque[bytes] = field(default_factory=deque)
    control_numbers: dict[int, bytes] = field(default_factory=dict)
    flight: bytes | None = None
    flight_frame: bytes = b""
    flight_control: bool = False
    behind_job: bool = False
    second: bytes | None = None
    second_frame: bytes = b""
    withheld: bytes = b""
    cut: int = 0
    refusing: bool = False
    awaiting: tuple[int, bytes] | None = None
    faulty: bool = False
    fast: bool = False
    waits: bool = False
    rest: bytes = b""
    out: list[bytes] = field(default_factory=list)
    said: list[bytes] = field(default_factory=list)
    complaint: str = ""
    goal: QueryGoal = QueryGoal.GO_ON
    doubt: DoubtEvidence = field(default_factory=lambda: DoubtEvidence(0.0))
    confirming: bool = False
    names_lines: bool = False
    misnamed: int = -1
    misnamed_line: int = -1
    times_misnamed: int = 0
    plain: bool = False
    told_odd: bool = False
    set_backs: int = 0
    refusal: str = ""
    behind_moves: bytes = b""

    def fault(self, text: str, about_command: bool = False) -> Fault:
        """Hold the job: nothing more of it leaves until somebody has looked at the fault."""
        self.hold()
        self.faulty = True
        in_job = self.flight is not None and not self.flight_control
        answers = in_job or (self.flight is None and self.waits and self.behind_job)
        return Fault(text, self.lines_done + in_job, answers, about_command)

    def resend(self, command: bytes, in_job: bool, events: list[Event]) -> bool:
        """Count the next line as sent again; False where it was too often, which ends all."""
        noisy = self.errors.count(self.number)
        if noisy:
            events.append(noisy)
        if not self.errors.stuck:
            return True
        text = command.decode("ascii", "backslashreplace")
        line = self.lines_done + 1 if in_job else 0
        times = self.errors.in_turn
        self.end(LineRefused(self.number + 1, times, text, line, self.refusal), events)
        return False

    def recall(self, command: bytes) -> int:
        """Return which of the job's lines was that command, one-based, among the last few taken.

        0 where it was a control command; -1 where it was none of them.
        """
        line = self.lines_done
        for number in range(self.number, max(self.number - _RECALLED, 0), -1):
            own = self.control_numbers.get(number, b"")
            if number in self.tokens.numbers or own:
                if own == command:
                    return 0
            elif line > 0 and self.lines[line - 1] == command:
                return line
            else:
                line -= 1
        return -1

    def hear_token(self, text: bytes) -> bool:
        """Whether a line is a token's echo; what was asked before the newest is answered by it."""
        heard = self.tokens.hear(text)
        if heard and self.tokens.echoed:
            self.questions.forget(self.tokens.sent_s)
        return heard

    def hold(self) -> None:
        """Let no line of the job go on, nor one whose end hasn't left yet."""
        self.held, self.refusing = True, bool(self.withheld)

    def refuse_second(self) -> None:
        """Have the printer refuse a line whose end hasn't left yet: end it, its checksum wrong."""
        if self.withheld:
            self.out.append(b"\n")
            self.second, self.withheld, self.refusing = None, b"", False

    def begin_doubt(self, goal: QueryGoal, now: float) -> None:
        """Believe no ok, and wait until nothing is under way."""
        if self.second is not None:
            self.cut = self.lines_done + 2
        self.refuse_second()
        self.fast = False
        self.tokens.doubt()
        self.alone_until = self.number + self.timing.calm_lines
        self.goal, self.phase = goal, Phase.DRAIN
        flights = (self.flight,) if self.second is None else (self.flight, self.second)
        self.doubt = DoubtEvidence(now, now, self.number + 1, flights)
        self.deadline = now + self.timing.quiet_s

    def end(self, event: Event, events: list[Event]) -> None:
        """Take no further part."""
        self.phase, self.fast, self.deadline = Phase.OVER, False, math.inf
        events.append(event)


QUESTION: Final = timing.QUESTION
MAX_SET_BACKS: Final = 5
