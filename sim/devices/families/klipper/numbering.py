"""Klipper's treatment of line numbers and checksums: read, but not verified."""

from __future__ import annotations

import re
from typing import Final

_NUMBER: Final = re.compile(rb"[Nn]\d+\s*")


class KlipperNumbering:
    """Klipper's line numbering: accepts any line.

    Attributes
    ----------
    last_number : int
        How many lines were taken.
    """

    def __init__(self) -> None:
        self.last_number = 0

    def accept(self, line: bytes) -> bytes:
        """The command without number and checksum."""
        match = _NUMBER.match(line)
        self.last_number += 1
        return (line[match.end() :] if match else line).partition(b"*")[0]

    def clear(self) -> None:
        """Count anew, as a reset does."""
        self.last_number = 0
