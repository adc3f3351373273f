"""Table of the commands that RepRapFirmware knows, with their parameters.

Every ``case`` of ``GCodes2.cpp`` (3.5) but M667, which it refuses; a macro file of a command's
name makes it known, too. Words: 3.x ``GCodes*.cpp``.
"""

from __future__ import annotations

from typing import Final

from firmware_profiles.families.common_words import COMMON
from firmware_profiles.families.grammar import codes, number_range

CODES: Final = codes(
    "G",
    number_range(0, 4),
    10,
    11,
    number_range(17, 21),
    number_range(28, 32),
    38,
    number_range(53, 60),
    68,
    69,
    number_range(90, 94),
) | codes(
    "M",
    *(
        number_range(0, 5),
        17,
        18,
        number_range(20, 30),
        32,
        number_range(36, 39),
        42,
        73,
        number_range(80, 85),
        92,
        98,
        99,
    ),
    *(number_range(101, 112), number_range(114, 122), 140, 141, 143, 144, 150, 190, 191, 200, 201),
    *(
        number_range(203, 208),
        220,
        221,
        226,
        260,
        261,
        280,
        number_range(290, 292),
        number_range(300, 304),
        number_range(307, 309),
    ),
    *(
        350,
        number_range(374, 376),
        number_range(400, 402),
        404,
        number_range(407, 409),
        425,
        number_range(450, 453),
        470,
        471,
        486,
    ),
    *(
        number_range(500, 503),
        505,
        540,
        number_range(550, 572),
        number_range(574, 577),
        579,
        581,
        582,
        number_range(584, 589),
    ),
    *(
        number_range(591, 601),
        665,
        666,
        number_range(669, 673),
        675,
        number_range(701, 703),
        851,
        905,
        906,
        911,
        912,
        913,
    ),
    *(number_range(915, 918), 929, number_range(950, 957), number_range(997, 999)),
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
