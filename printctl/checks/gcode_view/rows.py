"""Select the rows of a G-code file that move or extrude, with the kind of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.report.gcode import Act
from sim.gcode.heads import Valve
from sim.gcode.program.gcode import Program
from sim.gcode.program.modal import DWELL, HOME, MOVE

_STILL_MM: Final = 1e-9


@dataclass(frozen=True, eq=False)
class Rows:
    """The program's rows that move or push.

    Attributes
    ----------
    row : (n,) int64
        In the program.
    start, end : (n, 3) float64, mm
    plunger : (n,) float64, mm
        How far it goes.
    time : (n,) float64, s
        From the feeds, with the dwells until the next row.
    act : (n,) uint8
        `Act`; a travel's height isn't looked at yet.
    """

    row: IntArray
    start: FloatArray
    end: FloatArray
    plunger: FloatArray
    time: FloatArray
    act: NDArray[np.uint8]

    @property
    def way(self) -> FloatArray:
        """Length of each, (n,), mm."""
        return np.asarray(np.linalg.norm(self.end - self.start, axis=1))


def written_rows(program: Program, valve: Valve | None, start_known: bool) -> Rows:
    """Take the rows that move or push.

    Parameters
    ----------
    program : Program
    valve : Valve or None
        Open, it makes a way a written one; without a valve a rising E does.
    start_known : bool
        Whether the program begins where the tip really stands.
    """
    begin = program.before[:, :3]
    end = program.target[:, :3]
    push = np.diff(program.plunger, prepend=0.0)
    way = np.linalg.norm(end - begin, axis=1)
    moving, homing = program.kind == MOVE, program.kind == HOME
    goes, pushes = moving & (way > _STILL_MM), moving & (np.abs(push) > _STILL_MM)
    kept = np.flatnonzero(goes | pushes | homing)
    act = np.full(len(program), Act.TRAVEL, np.uint8)
    act[goes & (push < -_STILL_MM)] = Act.WIPE
    act[pushes & ~goes] = np.where(push[pushes & ~goes] > 0, Act.PRIME, Act.RETRACT)
    act[goes & ((push > _STILL_MM) if valve is None else valve.is_open)] = Act.WRITE
    act[homing] = Act.JUMP
    if not start_known and len(kept):
        _forget_the_way_there(act, begin, end, goes)
    asked = np.where(goes, way, np.abs(push)) / np.maximum(program.feed, 1e-9)
    time = np.where(moving, asked, 0.0)
    time += np.where(program.kind == DWELL, np.nan_to_num(program.value), 0.0)
    if len(kept):
        whose = np.maximum(np.searchsorted(kept, np.arange(len(program)), side="right") - 1, 0)
        time = np.bincount(whose, weights=time, minlength=len(kept))
    return Rows(kept, begin[kept], end[kept], push[kept], time, act[kept])


def _forget_the_way_there(
    act: NDArray[np.uint8], begin: FloatArray, end: FloatArray, goes: BoolArray
) -> None:
    """Mark what comes before x, y and z have all been said once: its place isn't known."""
    moved = [np.flatnonzero(goes & (begin[:, axis] != end[:, axis])) for axis in range(3)]
    known = max((int(rows[0]) for rows in moved if len(rows)), default=-1)
    writes = np.flatnonzero(act == Act.WRITE)
    early = np.arange(len(act)) <= (min(known, int(writes[0])) if len(writes) else known)
    act[early & goes & (act != Act.WRITE)] = Act.JUMP
