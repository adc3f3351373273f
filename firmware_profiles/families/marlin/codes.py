"""Command and parameter table of a stock Marlin 2.1 build.

After the recorded build (`tests/sim/data/marlin`); what isn't here is an unknown command. A
stock build knows no inches (G20: INCH_MODE_SUPPORT); the profile of one that does names it
(`extra_commands`). Words: Marlin bugfix-2.1.x ``src/gcode/**`` and marlinfw.org/meta/gcode.
"""

from __future__ import annotations

from typing import Final

from firmware_profiles.families.common_words import COMMON
from firmware_profiles.families.grammar import codes, number_range

CODES: Final = codes("G", number_range(0, 4), 21, 28, 90, 91, 92) | codes(
    "M",
    *(
        0,
        1,
        17,
        18,
        31,
        75,
        76,
        77,
        number_range(81, 85),
        92,
        number_range(104, 115),
        number_range(117, 121),
    ),
    *(140, 154, 155, 190, 200, 201, number_range(203, 206), 211, 220, 221, 301, 302, 400, 410, 428),
    *(number_range(500, 504), 876, 999),
)

WORDS: Final[dict[str, str]] = {
    **COMMON,
    "M31": "",
    "M76": "",
    "M77": "",
    "M81": "S?",
    "M111": "S",
    "M113": "S",
    "M120": "",
    "M121": "",
    "M154": "S",
    "M155": "S",
    "M200": "D S T L",
    "M205": "X Y Z E B J S T",
    "M206": "X Y Z",
    "M211": "S",
    "M218": "T X Y Z",
    "M220": "S B? R?",
    "M301": "P I D C L F E",
    "M428": "",
    "M500": "",
    "M501": "",
    "M502": "",
    "M503": "S C?",
    "M504": "",
    "M876": "P S",
    **{f"T{number}": "F S" for number in range(8)},
}

WHOLE: Final = frozenset({"M220", "M221"})
