"""Heads and valves of a job: which head is in use, is a valve open, and commands for both.

Each command states a target: sent twice it does no harm. Whether the firmware chose a head some
families say (`Family.head_confirms`), others are silent. What switches a pneumatic head's valve the
profile says (`dispenser`: opens, closes); a line of the job is about the valve if it has the same
command and the words that both have in common (a fan, a pin), in any order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

from firmware_profiles import PRESSURE_SETTLES_S, Pneumatic, Printer
from firmware_profiles.families import family_of, meanings
from firmware_profiles.families.grammar import Meaning
from gcode.reading import read_sent


def head_chosen(line: bytes) -> int | None:
    """Return the head that a line chooses; None for any other line."""
    if line[:1] in (b"G", b"M", b""):
        return None
    read = read_sent(line)
    if read.code[:1] == "T" and read.code[1:].isdigit():
        return int(read.code[1:])
    name = read.parameters.get("EXTRUDER", "").lower()
    number = name.removeprefix("extruder")
    chooses = meanings().get(read.code) is Meaning.CHOOSES and name.startswith("extruder")
    return int(number or 0) if chooses and (not number or number.isdigit()) else None


def head_at(lines: Sequence[bytes], done: int, printer: Printer) -> int | None:
    """Return the head in use after ``done`` lines: chosen last, or its valve opened last.

    None for a printer of one head, and where the job hasn't taken one yet.
    """
    if not printer.heads:
        return None
    opened = {_profiles(air.opens): number for number, air in enumerate(printer.airs)}
    for line in reversed(lines[:done]):
        if line[:1] == b"G" and line[1:2].isdigit():
            continue
        number = opened.get(_words(line)) if opened else head_chosen(line)
        if number is not None:
            return number
    return None


def choose(printer: Printer, number: int) -> bytes:
    """Return the command that chooses that head; empty where its valve does."""
    return (printer.heads[number].select or "").encode("ascii")


def confirms(replies: Sequence[bytes], printer: Printer, number: int) -> bool:
    """Whether the firmware says that it uses that head; true of one that says nothing of it."""
    ways = family_of(printer).head_confirms(number)
    return not ways or any(text.endswith(ways) for text in replies)


def keep_raised(lines: Sequence[bytes], done: int, printer: Printer) -> list[bytes]:
    """Commands that raise once more the heads that the job has raised, and left so."""
    commands = []
    for head in printer.heads:
        raises, lowers = ((text or "").encode("ascii") for text in (head.raises, head.lowers))
        last = next((line for line in reversed(lines[:done]) if line in (raises, lowers)), b"")
        commands += [raises] if last and last == raises else []
    return commands


def all_raised(printer: Printer) -> list[bytes]:
    """Commands that raise every head that can be, and wait until they are up."""
    moving = [head for head in printer.heads if head.raises is not None]
    commands = [(head.raises or "").encode("ascii") for head in moving]
    return commands + _dwell(max((head.moving_s for head in moving), default=0.0))


def lowered(lines: Sequence[bytes], done: int, printer: Printer) -> list[bytes]:
    """Commands that lower what the job has lowered, once the motors stand; wait for it."""
    commands: list[bytes] = []
    for head in printer.heads:
        raises, lowers = ((text or "").encode("ascii") for text in (head.raises, head.lowers))
        last = next((line for line in reversed(lines[:done]) if line in (raises, lowers)), b"")
        if last and last == lowers:
            commands += [b"M400", lowers, *_dwell(head.moving_s)]
    return commands


def is_about_heads(line: bytes, printer: Printer) -> bool:
    """Whether a line chooses, raises or lowers a head."""
    if not printer.heads:
        return False
    moves = (one for head in printer.heads for one in (head.raises, head.lowers))
    return head_chosen(line) is not None or line in {one.encode("ascii") for one in moves if one}


def shut_valves(printer: Printer) -> list[bytes]:
    """Commands that shut every valve; none without one."""
    return [head.closes.encode("ascii") for head in printer.airs]


def shut(printer: Printer) -> list[bytes]:
    """Shut every valve, then set every pressure that a command sets to its resting value."""
    return [line.encode("ascii") for line in printer.safe_lines]


def pressures(lines: Sequence[bytes], done: int, printer: Printer) -> list[bytes]:
    """Commands that set each head's pressure as the job had set it last before ``done``; a wait."""
    last = (
        next((line for line in reversed(lines[:done]) if _is_about(line, *pair)), None)
        for pair in printer.pressure_pairs.values()
    )
    commands = [line for line in last if line is not None]
    return [*commands, *_dwell(PRESSURE_SETTLES_S)] if commands else []


def shut_and_wait(printer: Printer) -> list[bytes]:
    """Shut them, and wait until no ink flows any more."""
    slowest = max((head.closing_delay_s for head in printer.airs), default=0.0)
    return [*shut(printer), *_dwell(slowest)]


def reopen(lines: Sequence[bytes], done: int, printer: Printer) -> list[bytes]:
    """Open again what stood open after ``done`` of the job's lines; wait until ink flows."""
    heads = [head for head in printer.airs if _stands_open(lines, done, head)]
    slowest = max((head.opening_delay_s for head in heads), default=0.0)
    return [*(head.opens.encode("ascii") for head in heads), *_dwell(slowest)]


def is_open(lines: Sequence[bytes], done: int, printer: Printer) -> bool:
    """Whether a valve stands open after ``done`` lines, as the profile's ``opens`` has it."""
    return any(_stands_open(lines, done, head) for head in printer.airs)


def _stands_open(lines: Sequence[bytes], done: int, head: Pneumatic) -> bool:
    about = (line for line in reversed(lines[:done]) if _is_about(line, head.opens, head.closes))
    last = next(about, None)
    return last is not None and _words(last) == _profiles(head.opens)


def is_about_valve(line: bytes, printer: Printer) -> bool:
    """Whether a line sets a valve, be it between open and closed, or a head's pressure."""
    pairs = [(head.opens, head.closes) for head in printer.airs]
    pairs += printer.pressure_pairs.values()
    return any(_is_about(line, *pair) for pair in pairs)


def _is_about(line: bytes, one: str, other: str) -> bool:
    """Whether a line sets what two commands of the profile set otherwise."""
    if line[:1].upper() != one[:1].upper().encode("ascii"):
        return False
    (code, first), (_, second) = _profiles(one), _profiles(other)
    own_code, own = _words(line)
    return own_code == code and first & second <= own


_Words = frozenset[tuple[str, float | str | None]]


def _words(text: bytes) -> tuple[str, _Words]:
    """Code and words of a command."""
    read = read_sent(text)
    named = ((key, value.upper()) for key, value in read.parameters.items())
    return read.code, frozenset({*read.words.items(), *named})


@cache
def _profiles(text: str) -> tuple[str, _Words]:
    """A command of the profile."""
    return _words(text.encode("ascii"))


def _dwell(seconds: float) -> list[bytes]:
    return [b"G4 P%d" % math.ceil(seconds * 1e3)] if seconds > 0 else []
