"""Error messages for G-code lines that the reader refuses."""

from __future__ import annotations

from typing import Final

from sim.errors import LineError

_SHOWN: Final = 60
MOST_REFUSED: Final = 1_000
"""Refused lines after which the rest of a file isn't read."""

SORTS: Final[dict[str, str]] = {
    "not_text": "characters that can't be sent",
    "no_command": "lines that aren't a command",
    "bad_comment": "parentheses or quotes that don't close",
    "bad_checksum": "line numbers or checksums that are wrong",
    "bad_code": "codes that firmwares read differently",
    "bad_number": "words without a number that can be read",
    "huge_number": "numbers beyond what a firmware can hold",
    "unknown_word": "words that the firmware doesn't know for this code",
    "unknown_axis": "axes that the machine hasn't",
    "repeated_word": "words that stand twice in a line",
    "too_long": "lines longer than any firmware takes",
    "ambiguous": "words that firmwares read differently",
    "too_many": "places where reading was given up",
}
"""Sort to what it is, in the plural."""


def refusal(sort: str, text: bytes, reason: str) -> LineError:
    """Error for a line; ``sort`` is a key of `SORTS`."""
    shown = text.strip(b"\r\n\t ").decode("ascii", "backslashreplace")
    shown = shown if len(shown) <= _SHOWN else shown[:_SHOWN] + "..."
    return LineError(sort, shown, reason)
