"""Refuse G-code lines that firmwares interpret differently, or with meaningless values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from firmware_profiles.families import find_family
from sim.gcode.reading.faults import refusal
from sim.gcode.reading.words import MOTION

Words = Mapping[str, float | None]

_HEAD_CODES: Final = ("M104", "M109", "M218", "M221")


def check_meaning(code: str, words: Words, family: str, text: bytes) -> None:
    """Refuse a line that can't be meant, or is read in more than one way.

    Raises
    ------
    LineError
        With what is read differently, and what to write instead.
    """
    reason = (
        _of_motion(words) if code in MOTION else _OTHERS.get(code, _nothing)(words)
    ) or _of_numbers(code, words, family)
    if reason:
        raise refusal("ambiguous", text, reason)


def _nothing(words: Words) -> str:
    return ""


def _of_motion(words: Words) -> str:
    feed = words.get("F")
    if feed is not None and feed <= 0:
        return (
            f"F{feed:g} is left out by Marlin, an error to Klipper and the slowest feed to "
            "RepRapFirmware; write a feed above 0"
        )
    if "R" in words and ("I" in words or "J" in words):
        return "an arc has a centre (I J) or a radius (R), not both; firmwares choose differently"
    return ""


def _of_dwell(words: Words) -> str:
    if len(words) > 1:
        return "G4 has both P and S, of which firmwares take one or add them; keep one"
    if any(value is not None and value < 0 for value in words.values()):
        return "a dwell below 0 lasts 49 days on a Marlin; write a time of 0 or more"
    return ""


def _of_count(words: Words) -> str:
    if not words:
        return (
            "G92 alone sets every axis to 0 on some firmwares (the plunger too), and nothing on "
            "others; name them: G92 X0 Y0 Z0 E0"
        )
    return ""


_OTHERS: Final = {"G4": _of_dwell, "G92": _of_count}


def _of_numbers(code: str, words: Words, family: str) -> str:
    head = words.get("T") if code in _HEAD_CODES else None
    if head is not None and (head < 0 or head != int(head)):
        return f"T{head:g} isn't the number of a head; write 0, 1, ..."
    if code in find_family(family).grammar.whole:
        for letter, value in words.items():
            if value is not None and value != int(value):
                return f"{family} cuts {letter}{value:g} to a whole number; write one"
    return ""
