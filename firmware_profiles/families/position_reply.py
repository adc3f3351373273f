"""Reply to M114, in every family's wording."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

_POSITION: Final = re.compile(rb"([XYZE]):(-?\d+\.\d+)")


def parse_position(replies: Sequence[bytes]) -> dict[str, float]:
    """Read the reply to M114, mm, by axis letter; empty when it isn't there."""
    for text in replies:
        if text.startswith((b"X:", b"ok C: X:")) and b" Z:" in text:  # the latter is Smoothieware's
            words = text.split(b"Count")[0]
            return {axis.decode(): float(value) for axis, value in _POSITION.findall(words)}
    return {}
