"""Table of the commands that Klipper knows, with their parameters.

``gcode.py``, ``gcode_move.py``, ``toolhead.py``, ``extruder.py``, ``heaters.py``, ``fan.py`` and
docs/G-Codes.md: what a printer.cfg with an extruder, a bed and a fan gives. Macros and commands of
other sections are the machine's own.
"""

from __future__ import annotations

from typing import Final

from firmware_profiles.families.common_words import MOVE, TEXTS
from firmware_profiles.families.grammar import Meaning, codes, number_range

CODES: Final = codes("G", 0, 1, 4, 21, 28, 90, 91, 92) | codes(
    "M",
    18,
    82,
    83,
    84,
    number_range(104, 107),
    109,
    110,
    112,
    114,
    115,
    119,
    140,
    190,
    204,
    220,
    221,
    400,
)

NAMES: Final[dict[str, Meaning]] = {
    **dict.fromkeys(
        (
            "GET_POSITION",
            "RESTORE_GCODE_STATE",
            "SAVE_GCODE_STATE",
            "SET_FAN_SPEED",
            "SET_IDLE_TIMEOUT",
            "SET_PIN",
            "SET_PRESSURE_ADVANCE",
            "SET_VELOCITY_LIMIT",
            "STATUS",
            "TURN_OFF_HEATERS",
        ),
        Meaning.OTHER,
    ),
    "ACTIVATE_EXTRUDER": Meaning.CHOOSES,
    "SET_GCODE_OFFSET": Meaning.SHIFTS,
    "SET_HEATER_TEMPERATURE": Meaning.HEATS,
    "SET_KINEMATIC_POSITION": Meaning.PLACES,
    "TEMPERATURE_WAIT": Meaning.AWAITS,
}

WORDS: Final[dict[str, str]] = {
    **TEXTS,
    "G0": MOVE,
    "G1": MOVE,
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
