"""Record types for job writing and checks: firmware idle timeout, cold extrusion, head changes."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class IdleTimeout:
    """The firmware's own switch-off when the host is silent.

    Attributes
    ----------
    code : str
        Command that sets it.
    key : str
        Of the seconds, where the command has a name; empty for the word S.
    example : str
        The command as it may be written, for a message.
    """

    code: str
    key: str
    example: str

    def command(self, seconds: str) -> str:
        """Write the command that sets it."""
        return f"{self.code} {self.key}={seconds}" if self.key else f"{self.code} S{seconds}"


@dataclass(frozen=True)
class ColdExtrusion:
    """How a firmware is told to move the plunger without a hot end.

    Attributes
    ----------
    remedy : str
        What to do where it doesn't.
    reads : callable
        What M302 with such words says: 1 allows, -1 forbids, 0 neither.
    """

    remedy: str
    reads: Callable[[Mapping[str, float]], int]


def m302_by_p(words: Mapping[str, float]) -> int:
    """Read an M302 by P alone: 1 allows, -1 forbids, 0 neither."""
    if "P" not in words:
        return 0
    return 1 if words["P"] > 0 else -1


@dataclass(frozen=True, kw_only=True)
class HeadFacts:
    """How a firmware changes between several heads.

    Attributes
    ----------
    select : pattern
        Command that chooses a head; its group is the head's number, empty for 0.
    example : str
        Such a command, for a message.
    confirms : callable
        How a line ends by which it says that it uses head ``number``, one of several ways; none
        where it says nothing.
    macro_free : str
        Word and number without which a choice of head may run macros that move; empty for none.
    offset_code, offset_word : str
        Command by which it is told a head's offset, and the word for the head; empty for none.
    offset_needs_word : bool
        Whether that command without the word is another one; else it is about the head in use.
    first_offset : int
        First head that can have an offset.
    note : str
        What to see to where the heads' steps differ; empty for nothing.
    """

    select: re.Pattern[str]
    example: str
    confirms: Callable[[int], tuple[bytes, ...]] = lambda number: ()
    macro_free: str = ""
    offset_code: str = ""
    offset_word: str = ""
    offset_needs_word: bool = False
    first_offset: int = 0
    note: str = ""

    def number(self, select: str) -> int | None:
        """Head that a command chooses; None for any other command."""
        match = self.select.fullmatch(select)
        return int(match[1] or 0) if match else None


SELECT_BY_T = re.compile(r"T([0-7])(?: [SP]\d)?")
"""T1 S1 (Marlin: no move), T1 P0 (RepRapFirmware: no macros)."""


@dataclass(frozen=True)
class ConfigurationFacts:
    """Things that stand in the firmware's configuration, where nothing tells them.

    Attributes
    ----------
    place : str
        Its file.
    remedy : str
        What a person must see to before a plunger is moved.
    several_heads : bool
        Whether that holds for a job of several heads, too.
    widest_push : bool
        Whether it refuses a move that pushes more ink per length than a limit of its own.
    """

    place: str
    remedy: str
    several_heads: bool = True
    widest_push: bool = False
