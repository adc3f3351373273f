"""Find the head in use from job lines; give commands that select, raise and lower heads.

A command that chooses a head or raises one states a target: sent twice it does no harm. Whether the
firmware chose it, some families say (`Family.head_confirms`), others are silent.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from firmware_profiles import Printer
from firmware_profiles.families import family_of, meanings
from firmware_profiles.families.grammar import Meaning
from sim.gcode.reading import read_sent


def head_chosen(line: bytes) -> int | None:
    """The head that a line chooses; None for any other line."""
    if line[:1] in (b"G", b"M", b""):
        return None
    read = read_sent(line)
    if read.code[:1] == "T" and read.code[1:].isdigit():
        return int(read.code[1:])
    name = read.parameters.get("EXTRUDER", "").lower()
    number = name.removeprefix("extruder")
    chooses = meanings().get(read.code) is Meaning.CHOOSES and name.startswith("extruder")
    return int(number or 0) if chooses and (not number or number.isdigit()) else None


def head_at(lines: Sequence[bytes], done: int) -> int | None:
    """The head in use after ``done`` lines; None where the job hasn't chosen one."""
    for line in reversed(lines[:done]):
        number = head_chosen(line)
        if number is not None:
            return number
    return None


def choose(printer: Printer, number: int) -> bytes:
    """Command that has E move that head's plunger."""
    return printer.heads[number].select.encode("ascii")


def confirms(replies: Sequence[bytes], printer: Printer, number: int) -> bool:
    """Whether the firmware says that it uses that head; true of one that says nothing of it."""
    ways = family_of(printer).head_confirms(number)
    return not ways or any(text.endswith(ways) for text in replies)


def keep_raised(lines: Sequence[bytes], done: int, printer: Printer) -> list[bytes]:
    """Commands that raise once more the heads that the job has raised, and left so."""
    commands = []
    for head in printer.heads:
        if head.raises is None or head.lowers is None:
            continue
        raises, lowers = head.raises.encode("ascii"), head.lowers.encode("ascii")
        last = next((line for line in reversed(lines[:done]) if line in (raises, lowers)), b"")
        if last == raises:
            commands.append(raises)
    return commands


def all_raised(printer: Printer) -> list[bytes]:
    """Commands that raise every head that can be, and wait until they are up."""
    moving = [head for head in printer.heads if head.raises is not None]
    commands = [head.raises.encode("ascii") for head in moving if head.raises is not None]
    return _waited(commands, max((head.moving_s for head in moving), default=0.0))


def lowered(printer: Printer, number: int | None) -> list[bytes]:
    """Commands that lower a head, once the motors stand, and wait until it is down."""
    if number is None or not printer.heads or printer.heads[number].lowers is None:
        return []
    head = printer.heads[number]
    return _waited([b"M400", (head.lowers or "").encode("ascii")], head.moving_s)


def _waited(commands: list[bytes], seconds: float) -> list[bytes]:
    return [*commands, b"G4 P%d" % math.ceil(seconds * 1e3)] if commands and seconds else commands


def is_about_heads(line: bytes, printer: Printer) -> bool:
    """Whether a line chooses, raises or lowers a head."""
    if not printer.heads:
        return False
    moves = {
        command.encode("ascii")
        for head in printer.heads
        for command in (head.raises, head.lowers)
        if command is not None
    }
    return head_chosen(line) is not None or line in moves
