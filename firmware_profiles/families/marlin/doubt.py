"""State of a doubt about Marlin's last accepted line: replies heard, whether they agree."""

from __future__ import annotations

from collections import deque
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
