"""Words that each code knows, by firmware family.

A letter needs a number; with ``?`` it may stand alone. `TEXT` marks a code whose rest is a text or
a file's name. A code that isn't in a family's table takes any well-formed word: whether it may be
sent at all is decided elsewhere (`sim.firmware_codes`).

Sources: Marlin bugfix-2.1.x ``src/gcode/**`` and marlinfw.org/meta/gcode; Prusa-Firmware
``Marlin_main.cpp``; RepRapFirmware 3.x ``GCodes*.cpp``; Klipper ``klippy/gcode.py``,
``klippy/extras/gcode_move.py``, ``toolhead.py``, ``heaters.py``, ``docs/G-Codes.md``; Smoothieware
``Robot.cpp``, ``GcodeDispatch.cpp``.
"""

from __future__ import annotations

from functools import cache
from typing import Final, NamedTuple

TEXT: Final = "text"
AXES: Final = frozenset("ABCDHIJKLOQUVWXYZ")
"""Letters that name axes on one machine or another."""
MOTION: Final = frozenset({"G0", "G1", "G2", "G3"})


class Known(NamedTuple):
    """Letters that a code knows."""

    letters: frozenset[str]
    alone: frozenset[str]
    """Those that need no number."""
    text: bool


_MOVE: Final = "X Y Z E F"
_ARC: Final = "X Y Z E F I J R"

# M2-style ends, files and texts: the rest of the line isn't words.
TEXT_CODES: Final = frozenset(
    {"M0", "M1", "M16", "M23", "M28", "M30", "M32", "M36", "M75", "M98", "M117", "M118", "M928"}
)
_TEXTS: Final = dict.fromkeys(TEXT_CODES, TEXT)

_COMMON: Final[dict[str, str]] = {
    **_TEXTS,
    "G0": _MOVE,
    "G1": _MOVE,
    "G2": _ARC,
    "G3": _ARC,
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

_MARLIN: Final[dict[str, str]] = {
    **_COMMON,
    "M31": "",
    "M76": "",
    "M77": "",
    "M111": "S",
    "M113": "S",
    "M149": "C? F? K?",
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

_PRUSA: Final[dict[str, str]] = {
    **_MARLIN,
    "G28": "X? Y? Z? W?",
    "M113": "S",
}

_RRF: Final[dict[str, str]] = {
    **_COMMON,
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
for _any in ("M18", "M84", "M92", "M115", "M201", "M203", "M220", "M204"):
    del _RRF[_any]

_KLIPPER: Final[dict[str, str]] = {
    **_TEXTS,
    "G0": _MOVE,
    "G1": _MOVE,
    "G2": "X Y Z E F I J",
    "G3": "X Y Z E F I J",
    "G4": "P",
    "G20": "",
    "G21": "",
    "G28": "X? Y? Z?",
    "G90": "",
    "G91": "",
    "G92": "X Y Z E",
    "M18": "",
    "M82": "",
    "M83": "",
    "M84": "",
    "M104": "S T",
    "M105": "",
    "M106": "P S",
    "M107": "P",
    "M109": "S T",
    "M110": "N",
    "M112": "",
    "M114": "",
    "M115": "",
    "M119": "",
    "M140": "S",
    "M190": "S",
    "M204": "S P T",
    "M220": "S",
    "M221": "S",
    "M400": "",
}

_SMOOTHIE: Final[dict[str, str]] = {**_COMMON}
for _any in ("M18", "M84", "M92", "M105", "M114", "M201", "M203", "M204", "M220", "M221"):
    del _SMOOTHIE[_any]

WORDS: Final[dict[str, dict[str, str]]] = {
    "marlin": _MARLIN,
    "prusa": _PRUSA,
    "reprapfirmware": _RRF,
    "klipper": _KLIPPER,
    "smoothieware": _SMOOTHIE,
    "aerotech": {
        "G0": _MOVE,
        "G1": _MOVE,
        "G4": "S",
        "G20": "",
        "G21": "",
        "G90": "",
        "G91": "",
        "G92": "X Y Z E",
    },
}
"""By the profile's ``firmware``, then by code."""

WHOLE: Final[dict[str, frozenset[str]]] = {
    "marlin": frozenset({"M220", "M221"}),
    "prusa": frozenset({"M220", "M221"}),
}
"""Codes whose numbers the family cuts to whole ones."""


@cache
def known(family: str, code: str) -> Known | None:
    """Letters of a code; None where any will do."""
    said = WORDS[family].get(code)
    if said is None:
        return None
    if said == TEXT:
        return Known(frozenset(), frozenset(), text=True)
    words = said.split()
    return Known(
        frozenset(word[0] for word in words),
        frozenset(word[0] for word in words if word.endswith("?")),
        text=False,
    )
