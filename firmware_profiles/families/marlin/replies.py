"""Classify Marlin's reply lines; frame outgoing commands with line number and checksum."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from functools import reduce
from operator import xor
from typing import Final

from firmware_profiles.families.known_messages import (
    COMPLAINTS,
    KnownMessage,
    MessageMeaning,
    load_messages,
)

ACTION: Final = re.compile(rb"// ?action:(.*)", re.DOTALL)
"""What the printer asks its host for."""


class Kind(Enum):
    """Kind of a Marlin reply."""

    OK = auto()
    BUSY = auto()
    WAIT = auto()
    RESEND = auto()
    ERROR = auto()
    HALT = auto()
    START = auto()
    ACTION = auto()
    UNKNOWN_COMMAND = auto()
    REFUSAL = auto()
    FAULT = auto()
    NOTICE = auto()
    CHATTER = auto()
    REPORT = auto()
    TEXT = auto()
    JUNK = auto()


@dataclass(frozen=True)
class Reply:
    """One line from the printer.

    Attributes
    ----------
    kind : Kind
    text : bytes
        The line without its end.
    number : int
        Of ``Resend``, of ``Last Line``, of an ``ok N`` (ADVANCED_OK); -1 for none.
    quoted : bytes
        What an unknown-command reply quotes.
    """

    kind: Kind
    text: bytes
    number: int = -1
    quoted: bytes = b""

    @property
    def words(self) -> str:
        """The text, printable."""
        return self.text.decode("ascii", "backslashreplace")

    @property
    def command(self) -> bytes:
        """The command that an unknown-command reply quotes, without number and checksum."""
        match = _SENT.match(self.quoted)
        return match[1].strip() if match else b""

    @property
    def halts(self) -> bool:
        """Whether the firmware stops for good."""
        return self.kind is Kind.HALT

    @property
    def complains(self) -> bool:
        """Whether it says that the printer or a command failed, and not the wire."""
        return self.kind in (Kind.FAULT, Kind.REFUSAL, Kind.UNKNOWN_COMMAND)

    @property
    def unnamed(self) -> bool:
        """Whether it is an ADVANCED_OK to a line that was sent without a number."""
        return self.kind is Kind.OK and self.number < 0 and self.text.startswith(b"ok P")

    @property
    def senseless(self) -> bool:
        """Whether it is an ADVANCED_OK whose room in planner or buffer can't be true."""
        return self.kind is Kind.OK and bool(_NO_ROOM.match(self.text))

    @property
    def forbids(self) -> bool:
        """Whether no line may leave after it: an error that isn't the wire's, a halt, a reset."""
        return self.complains or self.halts or self.kind is Kind.START


_ROOM: Final = rb"-?[\d.]+"
_OK = re.compile(rb"ok(?: N(\d+)(?: P%b)?(?: B%b)?| P%b B%b)?$" % (_ROOM, _ROOM, _ROOM, _ROOM))
_OK_REPORT = re.compile(rb"ok (?:[TX]:.*|[ BC]:?.*)$")
_NO_ROOM = re.compile(rb"ok.* [PB](?:-|\d*\.|\d{5})")
_RESEND = re.compile(rb"Resend: ?N?(\d+)$")
_LAST_LINE = re.compile(rb"Last Line: (\d+)$")
_SENT = re.compile(rb"(?:N\d+ ?)?([^*]*)", re.DOTALL)
"""A command within its frame."""
_REPORT = re.compile(rb"(?: ?T:| ?B:|X:)-?\d")
_PLAIN = re.compile(rb"[ -~]{5,}$")
_BANNER: Final = (b"Marlin ", b"echo: Last Updated")
"""What follows ``start``, which noise may have garbled."""
_KINDS: Final = {
    MessageMeaning.HALT: Kind.HALT,
    MessageMeaning.FAULT: Kind.FAULT,
    MessageMeaning.REFUSAL: Kind.REFUSAL,
    MessageMeaning.LINE_ERROR: Kind.ERROR,
    MessageMeaning.NOTICE: Kind.NOTICE,
    MessageMeaning.IGNORE: Kind.CHATTER,
}
ORDER_ERROR: Final = b"Line Number is not Last Line Number+1"
"""In the error that answers a line whose number is too high."""


def classify(text: bytes) -> Reply:
    """Tell what a line from Marlin is.

    A complaint counts wherever it stands in the line. Of the rest, anything that doesn't read
    exactly as a known form is `Kind.TEXT` when it is plain printable text, else `Kind.JUNK`. A
    garbled ``ok`` is junk, never an ok. Prusa's messages count too: other forks took them over.
    """
    if match := _OK.match(text):
        return Reply(Kind.OK, text, int(match[1]) if match[1] else -1)
    message = load_messages("prusa", "marlin").find(text)
    if message is not None and message.meaning in COMPLAINTS and not _asks_host(text, message):
        return _complaint(text, message)
    for test in _TESTS:
        reply = test(text)
        if reply is not None:
            return reply
    if message is not None:
        match = _LAST_LINE.search(text)
        number = int(match[1]) if match and message.meaning is MessageMeaning.LINE_ERROR else -1
        return Reply(_KINDS[message.meaning], text, number)
    return Reply(Kind.TEXT if _PLAIN.match(text) else Kind.JUNK, text)


def _asks_host(text: bytes, message: KnownMessage) -> bool:
    """Whether it is a text of an action for the host: a display's words are no complaint."""
    return message.meaning is not MessageMeaning.HALT and ACTION.match(text) is not None


def _complaint(text: bytes, message: KnownMessage) -> Reply:
    if message.command is None:
        return Reply(_KINDS[message.meaning], text)
    return Reply(Kind.UNKNOWN_COMMAND, text, quoted=message.command)


def may_be_line_error(half: bytes) -> bool:
    """Whether the beginning of a line may be that of a line error."""
    return any(
        (b"Error:" + start).startswith(half)
        for start in (ORDER_ERROR, b"checksum mismatch", b"No Checksum", b"No Line Number")
    )


def frame(number: int, command: bytes) -> bytes:
    """``N<number> <command>*<XOR of all bytes before the star>`` and line end."""
    body = b"N%d %b" % (number, command)
    return b"%b*%d\n" % (body, reduce(xor, body))


def _ok_with_report(text: bytes) -> Reply | None:
    return Reply(Kind.OK, text) if _OK_REPORT.match(text) else None


def _resend(text: bytes) -> Reply | None:
    match = _RESEND.match(text)
    return Reply(Kind.RESEND, text, int(match[1])) if match else None


def _plain(text: bytes) -> Reply | None:
    if text.startswith((b"echo:busy:", b"busy:")):
        return Reply(Kind.BUSY, text)
    if text == b"start" or text.startswith(_BANNER):
        return Reply(Kind.START, text)
    if text == b"wait":
        return Reply(Kind.WAIT, text)
    if ACTION.match(text):
        return Reply(Kind.ACTION, text)
    return Reply(Kind.REPORT, text) if _REPORT.match(text) else None


_TESTS: Final[tuple[Callable[[bytes], Reply | None], ...]] = (_ok_with_report, _resend, _plain)


# An ``ok`` doesn't say which line it answers, and may come at any later time. So after a doubt no
# ok is believed until a token (``M118 E1 at 33.2``) has come back: commands are carried out in the
# order in which they were taken, and each is answered before the next begins. What comes before the
# echo answers earlier lines; the first ok behind it is the token's own.
#
# A tail of the line that is run unchecked says its checksum too, and is no echo. A firmware without
# M118 quotes the command that it doesn't know, which is as good.
COMMAND: Final = b"M118 E1 "
MOST: Final = 2
"""Tokens that wait for their echo: with the line before them, fewer than a command queue holds."""
PATIENCE_S: Final = 20.0
"""Longest wait for the ok behind an echo."""
MOST_DOUBLINGS: Final = 8
TRIES: Final = 60
"""So many tokens that don't come back, though they are taken: the firmware has no such command."""
_GARBLED: Final = 2
IDLE_S: Final = 20.0
"""Without a busy message for so long nothing is being worked on: the echo was lost."""


class Tokens:
    """Which tokens were sent, and which oks were heard meanwhile.

    Attributes
    ----------
    suspect : bool
        Whether an ok may belong to an earlier line than the one in flight.
    flying : bool
        Whether the line in flight is a token.
    echoed : bool
        Whether the newest has come back.
    owed, heard : float
        Oks that are due from lines taken since the doubt began, and those that came.
    numbers : set of int
        Lines that were tokens.
    sent_s : float, s
        When the newest left.
    tries : int
        Tokens sent since oks were last believed, but those that weren't taken.
    doubted : bool
        Whether there was a doubt since oks were last believed: noise may have made lines.
    behind : bool
        Whether oks are due that come behind the newest token's own.
    """

    def __init__(self) -> None:
        self.suspect = self.flying = self.echoed = self.behind = self.doubted = False
        self.owed = self.heard = 0.0
        self.numbers: set[int] = set()
        self.sent_s = 0.0
        self._active_at = -math.inf
        self._moved_on = False
        self.tries = self._count = self._late = 0
        self._texts: list[bytes] = []

    def doubt(self) -> None:
        """Believe no ok from now on."""
        self.suspect = self.doubted = True

    def expect(self, oks: int) -> None:
        """Take notice of commands without numbers, each of which is answered by an ok."""
        self.suspect = True
        self.behind = self.flying
        self.owed += oks

    def forget_oks(self) -> None:
        """Nobody knows how many oks are due: what noise made of lines may be answered as well."""
        self.owed, self.heard = math.inf, 0.0

    def make(self, number: int, now: float) -> bytes:
        """Command of a new token, for line ``number``."""
        self._count += 1
        self.tries += 1
        self._late += self.flying and self.echoed
        text = b"at %d.%d" % (number, self._count)
        self._texts.append(text)
        self.suspect = self.flying = True
        self.behind = False
        self.echoed, self.sent_s, self._active_at = False, now, now
        self._moved_on = False
        return COMMAND + text

    def hear(self, text: bytes) -> bool:
        """Whether a line from the printer is the echo of a token; the newest is noted."""
        echo = text.removeprefix(b"echo:")
        for k, token in enumerate(self._texts):
            if echo == token or _quotes(text, token):
                self.echoed |= k == len(self._texts) - 1
                del self._texts[: k + 1]
                return True
        return False

    def quoted_by(self, text: bytes) -> bool:
        """Whether an unknown-command reply is to a token: there is no M118 in this firmware."""
        return any(token in text for token in self._texts)

    def resembles(self, text: bytes) -> bool:
        """Whether a line from the printer may be an echo that noise has garbled."""
        return any(
            _alike(text, form) for token in self._texts for form in (token, b"echo:" + token)
        )

    def move_on(self) -> None:
        """Something was answered since the newest left: there is room for one more."""
        self._moved_on = True

    def busy(self, now: float) -> None:
        """The printer is working on a line."""
        self._active_at = now

    def waited(self, now: float) -> float:
        """Seconds since the newest token left or the printer was last busy."""
        return now - self._active_at

    def ok_wait_s(self, answer_s: float) -> float:
        """Seconds to wait for the ok behind an echo: twice as long after each that was later."""
        return min(answer_s * 2.0 ** min(self._late, MOST_DOUBLINGS), PATIENCE_S)

    def may_send(self, now: float, keepalive: bool) -> bool:
        """Whether one more may be sent while those before it haven't come back.

        They may all wait behind a long move, and the command queue has four places.
        """
        idle = keepalive and now - self._active_at > IDLE_S
        return self.echoed or self._moved_on or len(self._texts) < MOST or idle

    def drop(self) -> None:
        """The token in flight wasn't taken."""
        self.tries -= self.flying
        self.flying = False
        if self._texts and not self.echoed:
            self._texts.pop()

    def settle(self) -> int:
        """The newest was answered: trust oks again; return how many more came than were due."""
        surplus = int(max(self.heard - self.owed, 0.0))
        self.suspect = self.flying = self.echoed = self.doubted = False
        self.owed = self.heard = 0.0
        self.tries, self._late = 0, max(self._late - 1, 0)
        self._texts.clear()
        return surplus


def _alike(text: bytes, token: bytes) -> bool:
    """Whether all but `_GARBLED` bytes of ``said`` begin or end a text of about its length."""
    if abs(len(text) - len(token)) > _GARBLED:
        return False
    begin = _alike_from_start(text, token)
    end = _alike_from_start(text[begin:][::-1], token[begin:][::-1])
    return begin + end >= len(token) - _GARBLED


def _alike_from_start(one: bytes, other: bytes) -> int:
    pairs = enumerate(zip(one, other, strict=False))
    return next((k for k, (a, b) in pairs if a != b), min(len(one), len(other)))


def _quotes(text: bytes, token: bytes) -> bool:
    command = classify(text).quoted
    return command.endswith(b" " + token) and command[:1] == b"M"
