"""Data class of a parsed G-code line: code, words, named parameters, and the text to send."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

_NOTHING: Final[Mapping[str, str]] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class GcodeLine:
    """One command.

    Attributes
    ----------
    code : str
        ``G1``, ``M104``, ``T0``, or the name of a Klipper or Aerotech command; empty where the
        line has none.
    words : mapping of str to (float or None)
        Capital letter to number, None for a letter alone (or with a quoted text), as in
        ``G28 X``. In the units of the line.
    text : bytes
        What is sent: capitals, one blank between words, the number's own digits; no line number,
        checksum, comment or line end.
    parameters : mapping of str to str
        Of a command with a name: ``KEY=value``.
    """

    code: str
    words: Mapping[str, float | None]
    text: bytes
    parameters: Mapping[str, str] = field(default_factory=lambda: _NOTHING)

    def __bool__(self) -> bool:
        return bool(self.code)

    def number(self, letter: str) -> float | None:
        """The number behind a letter; None without one."""
        return self.words.get(letter)


BLANK: Final = GcodeLine("", {}, b"")
"""A comment, or nothing."""
