"""Parse commands with a free text; refuse a second command on the same line.

RepRapFirmware (``StringParser.cpp``) takes several commands from one line. There a text ends with
its closing quote, and what follows is carried out; only some codes take the rest of the line as it
is (`Grammar.rest_codes`), and only without a quote. It works out a text in braces
(`Grammar.expressions`), and carries out what follows it.
"""

from __future__ import annotations

import re
from typing import Final

from firmware_profiles.families import find_family
from sim.errors import LineError
from sim.gcode.reading.faults import refusal
from sim.gcode.reading.line import GcodeLine

_QUOTED: Final = re.compile(rb'"[^"]*"')
_WHOLE: Final = re.compile(rb'"[^"]*"(?:"[^"]*")*')
_COMMAND: Final = re.compile(rb"[GMTgmt][ \t]*\d")


def text_line(code: str, rest: bytes, text: bytes, family: str) -> GcodeLine:
    """Read a code whose rest is a text.

    Parameters
    ----------
    code : str
    rest : bytes
        Behind the code's number.
    text : bytes
        The whole line, for messages.
    family : str
        The profile's ``firmware``.

    Raises
    ------
    LineError
        For a text that renumbers lines, one that the firmware works out, and one behind or in
        which it finds a command.
    """
    argument = b" ".join(rest.split(b"\t")).strip(b" ")
    if b"M110" in argument.replace(b" ", b"").upper():
        raise refusal(
            "ambiguous", text, "a text with M110 in it renumbers the lines of a Marlin; write "
            "another text"
        )  # fmt: skip
    _no_expression(argument, text, family)
    _one_command(code, argument, text, family)
    return GcodeLine(code, {}, code.encode() + (b" " + argument if argument else b""))


def second_command(shown: str, text: bytes) -> LineError:
    """Error for a line with a second command in it."""
    return refusal(
        "ambiguous", text, f"{shown!r} is another command of the line to some firmwares and "
        "nothing to others; write each command on a line of its own"
    )  # fmt: skip


def _no_expression(argument: bytes, text: bytes, family: str) -> None:
    """Refuse braces, wherever they stand, where the firmware works out what is in them."""
    if find_family(family).grammar.expressions and (b"{" in argument or b"}" in argument):
        raise refusal(
            "ambiguous", text, f"{family} works out a text in braces, and what stands behind it is "
            "carried out as another command; write the text without braces"
        )  # fmt: skip


def _one_command(code: str, argument: bytes, text: bytes, family: str) -> None:
    """Refuse what stands behind a closed quote, or is a command in a text that isn't quoted."""
    rest_codes = find_family(family).grammar.rest_codes
    if rest_codes is None:
        return
    if code in rest_codes:
        if b'"' in argument and not _WHOLE.fullmatch(argument):
            raise refusal(
                "ambiguous", text, f"to {family} the text ends with its quote, and what stands "
                "beside it may be carried out; write the whole text in one pair of quotes"
            )  # fmt: skip
        return
    match = _COMMAND.search(_QUOTED.sub(b"", argument))
    if match is not None:
        raise second_command(match[0].decode(), text)
