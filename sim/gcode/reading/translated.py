"""Data class of a non-G-code program file translated to G-code words."""

from __future__ import annotations

from dataclasses import dataclass

from sim.gcode.reading.named_commands import NamedCommand


@dataclass(frozen=True)
class TranslatedProgram:
    """A program file in the reader's words.

    Attributes
    ----------
    gcode : bytes
        As many lines as the file.
    named : tuple of NamedCommand
        Outputs that are set, and everything that isn't known.
    per_second : tuple of (int, bool)
        Lines from which on F is told per second, or per minute.
    """

    gcode: bytes
    named: tuple[NamedCommand, ...]
    per_second: tuple[tuple[int, bool], ...]
