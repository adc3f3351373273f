"""Which commands each firmware family knows; what isn't here is unknown to it.

- marlin: the recorded build (`sim.marlin_codes`).
- prusa: Marlin 1's commands in Prusa-Firmware's ``Marlin_main.cpp``; not verified on a board.
- reprapfirmware: every ``case`` of ``GCodes2.cpp`` (3.5) but M667, which it refuses; a macro file
  of a command's name makes it known, too.
- klipper: ``gcode.py``, ``gcode_move.py``, ``toolhead.py``, ``extruder.py``, ``heaters.py``,
  ``fan.py`` and docs/G-Codes.md: what a printer.cfg with an extruder, a bed and a fan gives. Macros
  and commands of other sections are the machine's own.
- aerotech: the words that `sim.dialect_aerotech` puts its commands into; what it can't is told by
  its name, and unknown.
- smoothieware: https://smoothieware.org/supported-g-codes; it answers ok to what it doesn't know.

What a machine knows beyond that its profile names (`extra_commands`).
"""

from __future__ import annotations

import re
from typing import Final

from firmware_profiles import Printer
from sim.dialect_aerotech import NAMES as OUTPUTS
from sim.marlin_codes import KNOWN as MARLIN
from sim.reading import GcodeLine

_CODE: Final = re.compile(r"[GMT]\d+")


def _names(letter: str, *numbers: int | range) -> frozenset[str]:
    found: list[int] = []
    for number in numbers:
        found += [number] if isinstance(number, int) else number
    return frozenset(f"{letter}{number}" for number in found)


def _to(first: int, last: int) -> range:
    return range(first, last + 1)


_NOT_PRUSAS: Final = _names("M", 113, 154, 428, 876)
_PRUSAS: Final = _names("G", 10, 11, 80) | _names("M", 42, 73, 80, 81, 201, 207, 226, 300, 600, 900)
_RRF: Final = _names(
    "G", _to(0, 4), 10, 11, _to(17, 21), _to(28, 32), 38, _to(53, 60), 68, 69, _to(90, 94)
) | _names(
    "M",
    *(_to(0, 5), 17, 18, _to(20, 30), 32, _to(36, 39), 42, 73, _to(80, 85), 92, 98, 99),
    *(_to(101, 112), _to(114, 122), 140, 141, 143, 144, 150, 190, 191, 200, 201),
    *(_to(203, 208), 220, 221, 226, 260, 261, 280, _to(290, 292), _to(300, 304), _to(307, 309)),
    *(350, _to(374, 376), _to(400, 402), 404, _to(407, 409), 425, _to(450, 453), 470, 471, 486),
    *(_to(500, 503), 505, 540, _to(550, 572), _to(574, 577), 579, 581, 582, _to(584, 589)),
    *(_to(591, 601), 665, 666, _to(669, 673), 675, _to(701, 703), 851, 905, 906, 911, 912, 913),
    *(_to(915, 918), 929, _to(950, 957), _to(997, 999)),
)
_KLIPPER: Final = _names("G", 0, 1, 4, 21, 28, 90, 91, 92) | _names(
    "M", 18, 82, 83, 84, _to(104, 107), 109, 110, 112, 114, 115, 119, 140, 190, 204, 220, 221, 400
)
_SMOOTHIE: Final = _names(
    "G", _to(0, 4), 10, 11, _to(17, 21), _to(28, 32), 38, 43, _to(53, 59), _to(90, 92)
) | _names(
    "M",
    *(17, 18, 20, 21, _to(23, 27), 30, 32, _to(82, 84), 92, _to(104, 107), 109, 110, 112, 114),
    *(115, 117, 119, 120, 121, 140, 190, 200, _to(203, 208), 220, 221, 301, 303, 304, 305, 306),
    *(307, 374, 375, 400, _to(500, 504), 557, 561, 565, 600, 601, 665, 666, 670, 907, 911, 999),
)

KNOWN: Final[dict[str, frozenset[str]]] = {
    "marlin": MARLIN,
    "prusa": (MARLIN - _NOT_PRUSAS) | _PRUSAS,
    "reprapfirmware": _RRF,
    "klipper": _KLIPPER,
    "smoothieware": _SMOOTHIE,
    "aerotech": _names("G", 0, 1, 4, 20, 21, 90, 91, 92) | _names("M", 105, 400),
}
"""By the profile's ``firmware``; T with any number is known to all."""

EXTENDED: Final = frozenset(
    {
        "ACTIVATE_EXTRUDER",
        "GET_POSITION",
        "RESTORE_GCODE_STATE",
        "SAVE_GCODE_STATE",
        "SET_FAN_SPEED",
        "SET_GCODE_OFFSET",
        "SET_HEATER_TEMPERATURE",
        "SET_IDLE_TIMEOUT",
        "SET_KINEMATIC_POSITION",
        "SET_PIN",
        "SET_PRESSURE_ADVANCE",
        "SET_VELOCITY_LIMIT",
        "STATUS",
        "TEMPERATURE_WAIT",
        "TURN_OFF_HEATERS",
    }
)
"""Klipper's commands with names."""


def is_known(printer: Printer, name: str) -> bool:
    """Whether the printer's firmware knows a command by its letter and number: ``M104``."""
    if name == "M218" and printer.heads and printer.firmware == "marlin":
        return True
    return name.startswith("T") or name in KNOWN[printer.firmware] or name in printer.extra_commands


def is_known_name(printer: Printer, name: str) -> bool:
    """Whether a Klipper, or an Aerotech controller, knows a command with a name."""
    known = OUTPUTS if printer.firmware == "aerotech" else EXTENDED
    return name in known or name in {other.upper() for other in printer.extra_commands}


def is_known_line(printer: Printer, line: GcodeLine) -> bool:
    """Whether the printer's firmware knows the command of a line that was read."""
    if _CODE.fullmatch(line.code):
        return is_known(printer, line.code)
    return printer.firmware in ("klipper", "aerotech") and is_known_name(printer, line.code)
