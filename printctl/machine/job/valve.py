"""A pneumatic head's valve: its state in the job, and commands to shut and reopen it.

What switches it the profile says (`dispenser`: opens, closes). A line of the job is about the valve
if it has the same command and the words that both have in common (a fan, a pin), in any order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

from firmware_profiles import Printer
from sim.gcode.reading import read_sent

Words = frozenset[tuple[str, float | str | None]]


def shut(printer: Printer) -> list[bytes]:
    """Commands that shut the valve; none without a valve. Safe to repeat."""
    head = printer.pneumatic
    return [] if head is None else [head.closes.encode("ascii")]


def shut_and_wait(printer: Printer) -> list[bytes]:
    """Shut it, and wait until no ink flows any more."""
    head = printer.pneumatic
    return [] if head is None else [*shut(printer), *_dwell(head.closing_delay_s)]


def reopen(lines: Sequence[bytes], done: int, printer: Printer) -> list[bytes]:
    """Open it again if it stood open after ``done`` lines, and wait until ink flows.

    Parameters
    ----------
    lines : sequence of bytes
        The job's.
    done : int
        How many of them were taken.
    printer : Printer
    """
    head = printer.pneumatic
    if head is None or not is_open(lines, done, printer):
        return []
    return [head.opens.encode("ascii"), *_dwell(head.opening_delay_s)]


def is_open(lines: Sequence[bytes], done: int, printer: Printer) -> bool:
    """Whether the last of ``done`` lines that is about the valve is the profile's ``opens``."""
    head = printer.pneumatic
    if head is None:
        return False
    opens = _profiles(head.opens)
    for line in reversed(lines[:done]):
        if is_about_valve(line, printer):
            return _words(line) == opens
    return False


def is_about_valve(line: bytes, printer: Printer) -> bool:
    """Whether a line sets the valve, be it to something between open and closed."""
    head = printer.pneumatic
    if head is None or line[:1].upper() != head.opens[:1].upper().encode("ascii"):
        return False
    opens, closes = _profiles(head.opens), _profiles(head.closes)
    said = _words(line)
    return said[0] == opens[0] and opens[1] & closes[1] <= said[1]


def _words(text: bytes) -> tuple[str, Words]:
    """Code and words of a command."""
    read = read_sent(text)
    return read.code, frozenset(
        {*read.words.items(), *((key, value.upper()) for key, value in read.parameters.items())}
    )


@cache
def _profiles(text: str) -> tuple[str, Words]:
    """A command of the profile."""
    return _words(text.encode("ascii"))


def _dwell(seconds: float) -> list[bytes]:
    return [b"G4 P%d" % math.ceil(seconds * 1e3)] if seconds > 0 else []
