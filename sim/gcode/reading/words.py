"""Parameter letters that each G-code accepts, by firmware family.

A code that isn't in a family's table takes any well-formed word: whether it may be sent at all is
decided elsewhere (`sim.gcode.reading.firmware_codes`).
"""

from __future__ import annotations

from functools import cache
from typing import Final, NamedTuple

from firmware_profiles.families import find_family
from firmware_profiles.families.grammar import TEXT

AXES: Final = frozenset("ABCDHIJKLOQUVWXYZ")
"""Letters that name axes on one machine or another."""
MOTION: Final = frozenset({"G0", "G1", "G2", "G3"})


class AcceptedLetters(NamedTuple):
    """Parameter letters that a code accepts."""

    letters: frozenset[str]
    alone: frozenset[str]
    """Those that need no number."""
    text: bool


@cache
def accepted_letters(family: str, code: str) -> AcceptedLetters | None:
    """Letters of a code; None where any will do."""
    letters = find_family(family).grammar.words.get(code)
    if letters is None:
        return None
    if letters == TEXT:
        return AcceptedLetters(frozenset(), frozenset(), text=True)
    words = letters.split()
    return AcceptedLetters(
        frozenset(word[0] for word in words),
        frozenset(word[0] for word in words if word.endswith("?")),
        text=False,
    )
