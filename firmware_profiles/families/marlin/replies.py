"""Classify Marlin's reply lines; frame outgoing commands with line number and checksum."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from functools import reduce
from operator import xor
from typing import Final


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
    FAULT = auto()
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
    """

    kind: Kind
    text: bytes
    number: int = -1

    @property
    def words(self) -> str:
        """The text, printable."""
        return self.text.decode("ascii", "backslashreplace")

    @property
    def halts(self) -> bool:
        """Whether the firmware stops for good."""
        return self.kind is Kind.HALT or self.text == b"//action:poweroff"

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
        return (
            self.kind in (Kind.FAULT, Kind.START)
            or self.halts
            or (self.kind is Kind.ERROR and self.number < 0)
        )


_ROOM: Final = rb"-?[\d.]+"
_OK = re.compile(
    rb"ok(?: N(\d+)(?: P%b)?(?: B%b)?| P%b B%b| T:.*| [ BC]:?.*)?$" % (_ROOM, _ROOM, _ROOM, _ROOM)
)
_NO_ROOM = re.compile(rb"ok.* [PB](?:-|\d*\.|\d{5})")
_RESEND = re.compile(rb"(?:Resend:|rs) ?N?(\d+)$")
_LAST_LINE = re.compile(rb"Error:.*Last Line: (\d+)$")
_UNKNOWN = re.compile(rb'echo:Unknown command: "(.*)"$', re.DOTALL)
_UNKNOWN_PRUSA = re.compile(rb"(?:echo:)?Unknown [GMTD] code: (.*)$", re.DOTALL)
_REPORT = re.compile(rb"(?: ?T:| ?B:|X:)-?\d")
_PLAIN = re.compile(rb"[ -~]{5,}$")

_BANNER: Final = (b"Marlin ", b"echo: Last Updated")
"""What follows ``start``, which noise may have garbled."""
_FAULTS: Final = (
    b"cold extrusion prevented",
    b"too long extrusion prevented",
    b"Invalid extruder",
)

ORDER_ERROR: Final = b"Line Number is not Last Line Number+1"
"""In the error that answers a line whose number is too high."""


def classify(text: bytes) -> Reply:
    """Tell what a line from Marlin is.

    Anything that doesn't read exactly as a known form is `Kind.TEXT` when it is plain printable
    text, else `Kind.JUNK`. A garbled ``ok`` is junk, never an ok.
    """
    for test in _TESTS:
        reply = test(text)
        if reply is not None:
            return reply
    return Reply(Kind.TEXT if _PLAIN.match(text) else Kind.JUNK, text)


def frame(number: int, command: bytes) -> bytes:
    """``N<number> <command>*<XOR of all bytes before the star>`` and line end."""
    body = b"N%d %b" % (number, command)
    return b"%b*%d\n" % (body, reduce(xor, body))


def _ok(text: bytes) -> Reply | None:
    if not text.startswith(b"ok"):
        return None
    match = _OK.match(text)
    return Reply(Kind.OK, text, int(match[1]) if match[1] else -1) if match else None


def _resend(text: bytes) -> Reply | None:
    match = _RESEND.match(text)
    return Reply(Kind.RESEND, text, int(match[1])) if match else None


def _error(text: bytes) -> Reply | None:
    if not text.startswith(b"Error:"):
        return None
    if text.startswith(b"Error:Printer halted"):
        return Reply(Kind.HALT, text)
    match = _LAST_LINE.match(text)
    return Reply(Kind.ERROR, text, int(match[1]) if match else -1)


def _echo(text: bytes) -> Reply | None:
    if text.startswith((b"echo:busy:", b"busy:")):
        return Reply(Kind.BUSY, text)
    if _UNKNOWN.match(text) or _UNKNOWN_PRUSA.match(text):
        return Reply(Kind.UNKNOWN_COMMAND, text)
    if text.startswith(b"echo:") and text.endswith(_FAULTS):
        return Reply(Kind.FAULT, text)
    return None


def _plain(text: bytes) -> Reply | None:
    if text == b"start" or text.startswith(_BANNER):
        return Reply(Kind.START, text)
    if text == b"wait":
        return Reply(Kind.WAIT, text)
    if text.startswith(b"//action:"):
        return Reply(Kind.ACTION, text)
    return Reply(Kind.REPORT, text) if _REPORT.match(text) else None


def unknown_command(text: bytes) -> bytes:
    """Give the command that an ``Unknown command`` echo quotes."""
    match = _UNKNOWN.match(text) or _UNKNOWN_PRUSA.match(text)
    return match[1] if match else b""


_TESTS: Final[tuple[Callable[[bytes], Reply | None], ...]] = (_ok, _resend, _error, _echo, _plain)
