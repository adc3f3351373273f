"""Whether a firmware lets the plunger move at each row of a program: there is no hot end."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Printer
from sim.gcode import Program, code, parse_line

_HOTEND_MELTS_C: Final = 170.0  # Marlin's EXTRUDE_MINTEMP
_WITHOUT_BAR: Final = ("smoothieware", "aerotech")
REMEDY: Final[dict[str, str]] = {
    "marlin": "send M302 P1 before",
    "prusa": "send M302 S0 before",
    "reprapfirmware": "send M302 P1 before",
    "klipper": "set min_extrude_temp to 0 in printer.cfg (extruder), then "
    "cold_extrusion_configured in the profile: no command does it",
}
"""What to do where it doesn't; Smoothieware and an Aerotech controller have no such bar."""


def extrusion_allowed(
    program: Program, gcode: bytes, printer: Printer, already: bool
) -> NDArray[np.bool_]:
    """Whether the firmware lets the plunger move at each row, (n,).

    Parameters
    ----------
    program : Program
    gcode : bytes
        What it was read from.
    printer : Printer
    already : bool
        Whether a command has allowed it before the file.
    """
    said = np.zeros(len(program), dtype=np.int8)  # 1 allows, -1 forbids
    value = np.nan_to_num(program.value, nan=-1.0)
    heats = np.isin(program.code, [code("M104"), code("M109")]) & (value >= _HOTEND_MELTS_C)
    said[heats] = 1
    rows = np.flatnonzero(program.code == code("M302"))
    lines = gcode.splitlines() if len(rows) else []
    for row in rows.tolist():
        said[row] = _m302(parse_line(lines[int(program.line[row]) - 1]).values, printer.firmware)
    free = already or printer.cold_extrusion_configured or printer.firmware in _WITHOUT_BAR
    before = np.append(1 if free else -1, said)
    latest = np.maximum.accumulate(np.where(before != 0, np.arange(len(before)), 0))
    return np.asarray(before[latest][1:] > 0)


def _m302(words: dict[str, float], firmware: str) -> int:
    """What an M302 says: 1 allows, -1 forbids, 0 neither; Prusa's has S alone, 0 by default."""
    if firmware == "prusa":
        return 1 if words.get("S", 0.0) == 0 else -1
    if "P" in words:
        return 1 if words["P"] > 0 else -1
    if "S" in words and firmware == "marlin":
        return 1 if words["S"] == 0 else -1
    return 0
