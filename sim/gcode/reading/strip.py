"""Take the command out of a G-code line; check its checksum and refuse unclear comments.

A comment begins at a semicolon; what stands in parentheses is one, too. Some builds of a firmware
take parentheses for words (Marlin without PAREN_COMMENTS), and a semicolon in quotes for text:
since the comment isn't sent, both then do the same, and where the two readings would leave
different commands the line is refused.
"""

from __future__ import annotations

import re
from binascii import crc_hqx
from functools import reduce
from operator import xor
from typing import Final

from firmware_profiles.families import find_family
from sim.gcode.reading.faults import refusal

_PARENTHESES: Final = re.compile(rb"\([^()]*\)")
_NUMBER: Final = re.compile(rb"[Nn]-?\d{1,10}(?![\d.])[ \t]*")
_CHECKSUM: Final = re.compile(rb"\*[ \t]*(\d+)[ \t]*")
_CRC_DIGITS: Final = 5
_LONGEST: Final = 2_000
"""Bytes of a command as it stands in a file, without the comment behind a semicolon: firmwares take
some 100 to 250, and what is sent is held against the profile's own limit (``max_line_bytes``)."""


def command_in(text: bytes, family: str) -> bytes:
    """Return the command in a line, empty where there is none.

    Parameters
    ----------
    text : bytes
        With or without line end.
    family : str
        The profile's ``firmware``.

    Raises
    ------
    LineError
        For a wrong checksum, comments that don't close, characters that can't be sent, or too many
        of them.
    """
    command = text.partition(b";")[0].strip(b" \t\r\n")
    if not command:
        return b""
    if len(command) > _LONGEST:
        raise refusal(
            "too_long", text, f"its command has {len(command)} bytes, at most {_LONGEST} are read "
            "(firmwares take some 100); take out what is too much"
        )  # fmt: skip
    command = _without_number(command, text, family)
    if b"(" in command or b")" in command:
        _comments_in_parentheses(text, family)
        command = _PARENTHESES.sub(b" ", command).strip(b" \t")
        if b"(" in command or b")" in command:
            raise refusal(
                "bad_comment", text, "a parenthesis isn't closed, or stands in another; firmwares "
                "differ in what they read then: write the comment behind a semicolon"
            )  # fmt: skip
    if command.count(b'"') % 2:
        raise refusal(
            "bad_comment", text, 'a quote isn\'t closed; write texts in "two quotes", without ;'
        )
    for char in command:
        if (char < 32 and char != 9) or char > 126 or char == 92:
            raise refusal(
                "not_text", text, f"byte {char} (0x{char:02x}) can't be sent in a command; remove "
                "it, or write it behind a semicolon"
            )  # fmt: skip
    return command


def _comments_in_parentheses(text: bytes, family: str) -> None:
    """Refuse parentheses where they are no comment."""
    if not find_family(family).grammar.parentheses:
        raise refusal(
            "bad_comment", text, f"{family} has no comments in parentheses and would read them as "
            "part of the command; write the comment behind a semicolon"
        )  # fmt: skip


def _without_number(command: bytes, text: bytes, family: str) -> bytes:
    """Take off line number and checksum, if that is right."""
    body, star, _ = command.partition(b"*")
    if star:
        _check(body, command[len(body) :], text, family)
    if body[:1] not in b"Nn":
        return body.rstrip(b" \t")
    number = _NUMBER.match(body)
    if number is None:
        raise refusal(
            "bad_checksum", text, "N isn't followed by a line number (N12); write it so or take "
            "it out"
        )  # fmt: skip
    return body[number.end() :].rstrip(b" \t")


def _check(body: bytes, rest: bytes, text: bytes, family: str) -> None:
    match = _CHECKSUM.fullmatch(rest)
    if match is None:
        raise refusal(
            "bad_checksum", text, "an asterisk begins a checksum, and no number alone follows it; "
            "take it out"
        )  # fmt: skip
    checksum = int(match[1]) if len(match[1]) <= _CRC_DIGITS else -1
    crc = find_family(family).grammar.crc16 and len(match[1]) == _CRC_DIGITS
    right = crc_hqx(body, 0) if crc else reduce(xor, body, 0)
    if checksum != right:
        raise refusal(
            "bad_checksum", text, f"its checksum is {match[1].decode()}, and the line's is "
            f"{right}: the line was changed or damaged; export the file again"
        )  # fmt: skip
