"""Classify Marlin's reply lines; frame outgoing commands with line number and checksum."""

from __future__ import annotations

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

ACTION: Final = re.compile(rb"// ?action:(.*)", re.DOTALL)
"""What the printer asks its host for."""
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
