"""Find where a job purges before its part, to purge and wipe there before a mend."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.toolpath.priming import Purge
from printctl.observe.mending.held_print import WAY_MM, HeldPrint
from sim.gcode.program.modal import MOVE

_RELIEFS: Final = 3.0
"""A push so many times a relief, with the needle standing, is a purge and no prime."""


def own_purge(held: HeldPrint, volume_ul: float) -> Purge | None:
    """Return the job's own purge place, with so much ink; None where it doesn't purge.

    A purge is a push with the needle standing, before anything is written. A straight way on at the
    same height behind it is its wipe.

    Parameters
    ----------
    held : HeldPrint
    volume_ul : float, µL
        To be pushed out before a mend: less than at the job's begin, whose syringe was fresh.
    """
    program, way = held.program, held.way
    first = int(np.argmax(held.writes)) if held.writes.any() else len(program)
    stands = (program.kind == MOVE) & (way <= WAY_MM)
    stands &= program.pushed > _RELIEFS * held.relief_e
    rows = np.flatnonzero(stands[:first])
    if not len(rows):
        return None
    row = int(rows[program.pushed[rows].argmax()])
    place = program.target[row, :3]
    return Purge(place, volume_ul, _wipe(held, row))


def _wipe(held: HeldPrint, row: int) -> NDArray[np.float64] | None:
    """End of the first way behind a row, where it stays at the row's height."""
    behind = np.flatnonzero(held.way[row + 1 :] > WAY_MM)
    if not len(behind):
        return None
    end = held.program.target[row + 1 + int(behind[0]), :3]
    level = abs(end[2] - held.program.target[row, 2]) <= WAY_MM
    return np.asarray(end) if level else None
