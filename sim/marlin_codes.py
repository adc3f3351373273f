"""Commands that a stock Marlin 2.1 build with one extruder and EEPROM answers to.

After the recorded build (`tests/sim/data/marlin`); what isn't here is an unknown command. A
stock build knows no inches (G20: INCH_MODE_SUPPORT); the profile of one that does names it
(`extra_commands`).
"""

from __future__ import annotations

from typing import Final

_G: Final = (0, 1, 2, 3, 4, 21, 28, 90, 91, 92)
_M: Final = (
    *(0, 1, 17, 18, 31, 75, 76, 77, 81, 82, 83, 84, 85, 92),
    *(104, 105, 106, 107, 108, 109, 110, 111, 112, 113, 114, 115, 117, 118, 119, 120, 121),
    *(140, 154, 155, 190, 200, 201, 203, 204, 205, 206),
    *(211, 220, 221, 301, 302, 400, 410, 428),
    *(500, 501, 502, 503, 504, 876, 999),
)

KNOWN: Final = frozenset([f"G{n}" for n in _G] + [f"M{n}" for n in _M])
"""Names of the known commands; T with any number is known too."""


def is_known(letter: str, number: int) -> bool:
    """Whether the firmware knows a command."""
    return letter == "T" or f"{letter}{number}" in KNOWN
