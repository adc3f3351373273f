"""Parse commands that set a digital output by name, such as ``$DO[0].X=1``."""

from __future__ import annotations

import re
from typing import Final

SETS_ARRAY: Final = "$DO"
SETS_CALL: Final = "DIGITALOUTPUTSET"
_ARRAY: Final = re.compile(r"\$DO(?:\[(\d+)\]\.|(\d+)\.)(\w+)\s*=\s*(\S+)", re.IGNORECASE)
_CALL: Final = re.compile(
    r"DigitalOutputSet\(\s*(\w+)\s*,\s*(\d+)\s*,\s*(\S+?)\s*\)", re.IGNORECASE
)


def output_of(text: str) -> tuple[str, dict[str, str]] | None:
    """Return the output that a command sets, and its words; None where it sets none."""
    match = _ARRAY.fullmatch(text.strip())
    if match:
        number = match[1] if match[1] is not None else match[2]
        return SETS_ARRAY, {"NUMBER": number, "AXIS": match[3].upper(), "VALUE": match[4]}
    called = _CALL.fullmatch(text.strip())
    if called:
        words = {"NUMBER": called[2], "AXIS": called[1].upper(), "VALUE": called[3]}
        return SETS_CALL, words
    return None
