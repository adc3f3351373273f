"""Table of the parameter letters of each G-code that most firmware families share.

See `firmware_profiles.families.grammar.Grammar.words` for how they are written.
"""

from __future__ import annotations

from typing import Final

from firmware_profiles.families.grammar import TEXT

MOVE: Final = "X Y Z E F"
ARC: Final = "X Y Z E F I J R"

# M2-style ends, files and texts: the rest of the line isn't words.
TEXT_CODES: Final = frozenset(
    {"M0", "M1", "M16", "M23", "M28", "M30", "M32", "M36", "M75", "M98", "M117", "M118", "M928"}
)
TEXTS: Final = dict.fromkeys(TEXT_CODES, TEXT)

COMMON: Final[dict[str, str]] = {
    **TEXTS,
    "G0": MOVE,
    "G1": MOVE,
    "G2": ARC,
    "G3": ARC,
    "G4": "P S",
    "G17": "",
    "G20": "",
    "G21": "",
    "G28": "X? Y? Z?",
    "G90": "",
    "G91": "",
    "G92": "X Y Z E",
    "M17": "X? Y? Z? E?",
    "M18": "S X? Y? Z? E?",
    "M82": "",
    "M83": "",
    "M84": "S X? Y? Z? E?",
    "M85": "S",
    "M92": "X Y Z E T",
    "M104": "S T",
    "M105": "T",
    "M106": "P S",
    "M107": "P",
    "M108": "",
    "M109": "S R T",
    "M110": "N",
    "M112": "",
    "M114": "D? E? R?",
    "M115": "",
    "M119": "",
    "M140": "S",
    "M141": "S",
    "M190": "S R",
    "M201": "X Y Z E T",
    "M203": "X Y Z E T",
    "M204": "S P R T",
    "M220": "S",
    "M221": "S T",
    "M302": "S P?",
    "M400": "",
    "M410": "",
    "M999": "S",
}
