"""Check that a printer's firmware knows a command, by code or by name.

What a machine knows beyond its family's commands its profile names (`extra_commands`).
"""

from __future__ import annotations

import re
from typing import Final

from firmware_profiles import Printer
from firmware_profiles.families import family_of
from sim.gcode.reading import GcodeLine

_CODE: Final = re.compile(r"[GMT]\d+")


def is_known(printer: Printer, name: str) -> bool:
    """Whether the printer's firmware knows a command by its letter and number: ``M104``."""
    grammar = family_of(printer).grammar
    if printer.heads and name in grammar.head_codes:
        return True
    return name.startswith("T") or name in grammar.codes or name in printer.extra_commands


def is_known_name(printer: Printer, name: str) -> bool:
    """Whether the printer's firmware knows a command with a name."""
    names = family_of(printer).grammar.names
    return name in names or name in {other.upper() for other in printer.extra_commands}


def is_known_line(printer: Printer, line: GcodeLine) -> bool:
    """Whether the printer's firmware knows the command of a line that was read."""
    if _CODE.fullmatch(line.code):
        return is_known(printer, line.code)
    grammar = family_of(printer).grammar
    return bool(grammar.named or grammar.names) and is_known_name(printer, line.code)
