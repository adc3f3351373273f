"""Read a G-code file's bytes as text: drop a UTF-8 byte order mark, refuse binary and UTF-16."""

from __future__ import annotations

from typing import Final

from sim.errors import GcodeError

_UTF_16: Final = (b"\xff\xfe", b"\xfe\xff")


def text_of(gcode: bytes) -> bytes:
    """Return the text of a file; raise `GcodeError` where it is binary or UTF-16."""
    if gcode.startswith(_UTF_16):
        raise GcodeError(
            "the G-code begins with UTF-16 text, which no printer reads; save it as plain text "
            "(UTF-8) in the editor"
        )
    at = gcode.find(b"\0")
    if at >= 0:
        line = gcode.count(b"\n", 0, at) + 1
        raise GcodeError(
            f"line {line} of the G-code has a NUL (byte {at}), as no text has: the file is binary "
            "or damaged; write it anew, or take the byte out in an editor"
        )
    return gcode.removeprefix(b"\xef\xbb\xbf")
