"""Commands that RepRapFirmware knows, with their parameters.

Every ``case`` of ``GCodes2.cpp`` (3.5) but M667, which it refuses; a macro file of a command's
name makes it known, too. Words: 3.x ``GCodes*.cpp``.
"""

from __future__ import annotations

from typing import Final

from firmware_profiles.families.common_words import COMMON
from firmware_profiles.families.grammar import codes, to

CODES: Final = codes(
    "G", to(0, 4), 10, 11, to(17, 21), to(28, 32), 38, to(53, 60), 68, 69, to(90, 94)
) | codes(
    "M",
    *(to(0, 5), 17, 18, to(20, 30), 32, to(36, 39), 42, 73, to(80, 85), 92, 98, 99),
    *(to(101, 112), to(114, 122), 140, 141, 143, 144, 150, 190, 191, 200, 201),
    *(to(203, 208), 220, 221, 226, 260, 261, 280, to(290, 292), to(300, 304), to(307, 309)),
    *(350, to(374, 376), to(400, 402), 404, to(407, 409), 425, to(450, 453), 470, 471, 486),
    *(to(500, 503), 505, 540, to(550, 572), to(574, 577), 579, 581, 582, to(584, 589)),
    *(to(591, 601), 665, 666, to(669, 673), 675, to(701, 703), 851, 905, 906, 911, 912, 913),
    *(to(915, 918), 929, to(950, 957), to(997, 999)),
)

_ANY_WORD: Final = ("M18", "M84", "M92", "M115", "M201", "M203", "M220", "M204")

WORDS: Final[dict[str, str]] = {
    **{code: words for code, words in COMMON.items() if code not in _ANY_WORD},
    "M106": "P S I F L X B H R T C?",
    "M109": "S R T P",
    "M110": "N",
    "M114": "",
    "M140": "P S R H",
    "M190": "P S R H",
    "M221": "S D",
    "M302": "P S R",
    "M400": "S P",
    "M999": "B P? A?",
    **{f"T{number}": "P" for number in range(8)},
}
