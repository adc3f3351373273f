"""State of a doubt about Marlin's last accepted line: replies heard, whether they agree."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, auto
from typing import Final

from firmware_profiles.families import harmless_query
from firmware_profiles.families.marlin.replies import (
    ORDER_ERROR,
    Kind,
    Reply,
    frame,
)

QUESTION: Final = harmless_query.QUESTION
RENUMBER: Final = b"\n" + frame(0, b"M110 N0")
MAX_SET_BACKS: Final = 5
LATENESS: Final = 1.5
"""Times the first answer's lateness, within which the last is expected."""
PROMPT_ANSWERS: Final = 4
"""So many running, each alone and soon after its question: what wasn't answered before is lost.
On a line that answers late, those of earlier questions seldom fall so."""


class Phase(Enum):
    """Phase of resolving a doubt."""

    READY = auto()
    FLIGHT = auto()
    DRAIN = auto()
    ASK = auto()
    SETTLE = auto()
    OVER = auto()


class QueryGoal(Enum):
    """What a question is asked for."""

    GO_ON = auto()
    NUMBER = auto()
    RENUMBER = auto()
    SET_BACK = auto()
    """The printer's count is set to the host's, which another program has changed."""


@dataclass
class DoubtEvidence:
    """What was heard since the doubt began.

    Attributes
    ----------
    since : float
        When it began, or the printer last said that it is busy, s.
    number : int
        Of the (first) line in flight.
    flights : tuple of (bytes or None)
        The command in flight, or two.
    two_resends : bool
        Whether the answer to a question is twice the same ``Resend``, each without an ok.
    by_silence : bool
        Whether nothing was heard, rather than something doubtful.
    asked : int
        Questions so far.
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
    answers_until : float, s
        Where fewer answers than questions came: until then another may be under way, unless the
        line proves prompt; -inf before the first.
    prompt : int
        Last answers running, each alone and soon after its question.
    probed : bool
        Whether a question was asked behind an answer, to see whether the line is prompt.
    """

    since: float
    number: int = 0
    flights: tuple[bytes | None, ...] = (None,)
    two_resends: bool = False
    by_silence: bool = False
    asked: int = 0
    alarmed: bool = False
    last: int = -1
    resend: int = -1
    confirmed: int = -1
    oks: int = 0
    quoted: bytes = b""
    answers_until: float = -math.inf
    prompt: int = 0
    probed: bool = False
    _foreign_ok: bool = False
    _first_asked: float = 0.0
    _asked_at: float = 0.0
    _since_asked: int = 0
    _orders: int = 0
    _resends: int = 0

    @property
    def answered(self) -> bool:
        """Whether both halves of an answer are there."""
        return self.last >= 0 and self.resend >= 0

    @property
    def agreed(self) -> bool:
        """Whether they say the same."""
        return self.last >= 0 and self.resend == self.last + 1

    def ask_again(self, now: float) -> None:
        """Forget the last answer; what it said of the ok to come, too."""
        self.last = self.resend = -1
        self._foreign_ok = False
        if not self.asked:
            self._first_asked = now
        self.asked += 1
        self._asked_at, self._since_asked = now, 0

    def take_answer(self, now: float, prompt_s: float) -> None:
        """Record when an answer came: one to the last question, if within ``prompt_s``.

        What came late for the first may come as late for the last.
        """
        self._since_asked += 1
        alone = self._since_asked == 1 and now - self._asked_at <= prompt_s
        self.prompt = self.prompt + 1 if alone else 0
        if self.answers == 1:
            self.answers_until = now + LATENESS * (now - self._first_asked)

    @property
    def answers(self) -> int:
        """Return how many questions were answered."""
        return max(self._orders, self._resends // (2 if self.two_resends else 1))

    def awaits_answers(self, now: float) -> bool:
        """Whether an answer to an earlier question may be under way: a later doubt's, it seemed."""
        late = self.answers < self.asked and now < self.answers_until
        return late and self.prompt < PROMPT_ANSWERS

    def hear(self, reply: Reply) -> None:
        """Take one more line into account."""
        kind = reply.kind
        if self.asked:
            self._resends += kind is Kind.RESEND
            self._orders += kind is Kind.ERROR and ORDER_ERROR in reply.text
        if kind is Kind.OK:
            self._hear_ok(reply)
        elif kind is Kind.RESEND and not self.two_resends:
            self.resend, self._foreign_ok = reply.number, True
        elif kind is Kind.RESEND and self.last < 0:
            self.last = reply.number - 1
        elif kind is Kind.RESEND:
            self.resend = reply.number
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
