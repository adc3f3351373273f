"""Mark each G-code row's plunger motion as allowed or barred by the cold-extrusion lock."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Printer
from firmware_profiles.families import family_of
from firmware_profiles.families.job_facts import m302_by_p
from sim.gcode.program.gcode import Program, code, parse_line

_HOTEND_MELTS_C: Final = 170.0  # Marlin's EXTRUDE_MINTEMP


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
    change = np.zeros(len(program), dtype=np.int8)  # 1 allows, -1 forbids
    value = np.nan_to_num(program.value, nan=-1.0)
    heats = np.isin(program.code, [code("M104"), code("M109")]) & (value >= _HOTEND_MELTS_C)
    change[heats] = 1
    cold = family_of(printer).cold
    reads = cold.reads if cold else m302_by_p
    rows = np.flatnonzero(program.code == code("M302"))
    lines = gcode.splitlines() if len(rows) else []
    for row in rows.tolist():
        change[row] = reads(parse_line(lines[int(program.line[row]) - 1]).values)
    free = already or printer.cold_extrusion_configured or cold is None
    before = np.append(1 if free else -1, change)
    latest = np.maximum.accumulate(np.where(before != 0, np.arange(len(before)), 0))
    return np.asarray(before[latest][1:] > 0)
