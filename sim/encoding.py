"""Refuse a G-code file that is binary, UTF-16 or begins with a UTF-8 byte order mark."""

from __future__ import annotations

from typing import Final

from sim.errors import GcodeError

_MARKS: Final = {
    b"\xef\xbb\xbf": "an invisible mark (UTF-8 BOM)",
    b"\xff\xfe": "UTF-16 text",
    b"\xfe\xff": "UTF-16 text",
}
"""What some editors write before a text."""


def check_text(gcode: bytes) -> None:
    """Raise `GcodeError` for a binary file, and for text that no printer reads."""
    for mark, name in _MARKS.items():
        if gcode.startswith(mark):
            raise GcodeError(
                f"the G-code begins with {name}, which no printer reads; save it as plain text "
                "(UTF-8 without BOM) in the editor"
            )
    at = gcode.find(b"\0")
    if at >= 0:
        line = gcode.count(b"\n", 0, at) + 1
        raise GcodeError(
            f"line {line} of the G-code has a NUL (byte {at}), as no text has: the file is binary "
            "or damaged; write it anew, or take the byte out in an editor"
        )
