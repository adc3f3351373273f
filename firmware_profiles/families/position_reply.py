"""Reply to M114, in every family's wording."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

_POSITION: Final = re.compile(rb"([XYZE]):(-?\d+\.\d+)")
_COUNT: Final = re.compile(rb" Count X: ?(-?\d+) Y: ?(-?\d+) Z: ?(-?\d+)$")


def parse_position(replies: Sequence[bytes]) -> dict[str, float]:
    """Read the reply to M114, mm, by axis letter; empty when it isn't there."""
    for text in replies:
        if text.startswith((b"X:", b"ok C: X:")) and b" Z:" in text:  # the latter is Smoothieware's
            words = text.split(b"Count")[0]
            return {axis.decode(): float(value) for axis, value in _POSITION.findall(words)}
    return {}


def parse_counts(replies: Sequence[bytes]) -> dict[str, int]:
    """Read Marlin's counts of steps from the reply to M114; empty where it tells none."""
    found = next((match for text in replies if (match := _COUNT.search(text))), None)
    return dict(zip("XYZ", map(int, found.groups()), strict=True)) if found else {}
