"""Parse named G-code commands: ``SET_PIN PIN=valve VALUE=1``."""

from __future__ import annotations

import re
from typing import Final

from firmware_profiles.families import meanings
from firmware_profiles.families.grammar import Meaning
from sim.gcode.reading.faults import refusal
from sim.gcode.reading.line import GcodeLine

_NAME: Final = re.compile(rb"([A-Za-z][A-Za-z_][A-Za-z0-9_]*)(?:[ \t]+|$)")
_PARAMETER: Final = re.compile(rb"([A-Za-z_][A-Za-z0-9_]*)=(\"[^\"]*\"|[^ \t\"'#=*]+)(?:[ \t]+|$)")
_PLAIN: Final = re.compile(rb"\"([^ \t\"'#=*]+)\"")
_NUMBER: Final = re.compile(rb"-?\d{1,6}(?:\.\d{1,9})?")
_PLACING: Final = (Meaning.PLACES, Meaning.SHIFTS)
_PLACES: Final = ("X", "Y", "Z", "X_ADJUST", "Y_ADJUST", "Z_ADJUST")


def named_line(command: bytes, text: bytes) -> GcodeLine | None:
    """Read a command with a name; None where the command has none.

    Raises
    ------
    LineError
        When what follows the name isn't ``KEY=value``, or a key stands twice.
    """
    match = _NAME.match(command)
    if match is None:
        return None
    name, at = match[1].upper(), match.end()
    parameters: dict[str, str] = {}
    parts = [name]
    placing = meanings().get(name.decode()) in _PLACING
    while at < len(command):
        word = _PARAMETER.match(command, at)
        if word is None:
            raise refusal(
                "bad_number", text, f"{command[at:].decode()!r} isn't KEY=value; correct it"
            )
        key = word[1].decode().upper()
        if key in parameters:
            raise refusal("repeated_word", text, f"{key} stands twice; keep one")
        if placing and key in _PLACES and not _NUMBER.fullmatch(word[2]):
            raise refusal(
                "bad_number", text, f"{key}={word[2].decode()!r} isn't a decimal number of at most "
                "6 and 9 digits; write one"
            )  # fmt: skip
        value = _unquoted(word[2])
        parameters[key] = value.strip(b'"').decode()
        parts.append(key.encode() + b"=" + value)
        at = word.end()
    return GcodeLine(name.decode(), {}, b" ".join(parts), parameters)


def _unquoted(value: bytes) -> bytes:
    """Take the quotes off that mean nothing."""
    match = _PLAIN.fullmatch(value)
    return match[1] if match else value
