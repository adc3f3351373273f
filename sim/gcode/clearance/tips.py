"""Build the shaft check's array of needle motion: each head's pieces with stroke and vessel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray
from sim.gcode.clearance.bodies import Tips
from sim.gcode.clearance.heads import Head
from sim.gcode.clearance.motion import NONE, NeedleMotion
from sim.gcode.clearance.pieces import Pieces


def tips_of(
    motion: NeedleMotion, heads: list[Head], pieces: Pieces, radius: FloatArray
) -> tuple[Tips, IntArray, IntArray]:
    """Every head's motion, with the rows and heads that its moves are of.

    Returns
    -------
    Tips
    row, head : (moves,) int64
    """
    parts, rows, numbers = [], [], []
    runs = moves = 0
    for k, head in enumerate(heads):
        kept = _kept(head.tips)
        chosen = np.flatnonzero(kept[pieces.row])
        parts.append(_fields(motion, k, head, pieces.of_rows(chosen), radius))
        move = np.cumsum(kept) - 1 + moves
        parts[-1] |= {"move": move[pieces.row[chosen]], "when": chosen}
        parts[-1]["run"][parts[-1]["run"] >= 0] += runs
        rows.append(np.flatnonzero(kept))
        numbers.append(np.full(len(rows[-1]), k))
        runs += int(head.passes.run.max(initial=-1)) + 1
        moves += len(rows[-1])
    columns = ([part[name] for part in parts] for name in Tips._fields)
    tips = Tips(*(np.ascontiguousarray(np.concatenate(column)) for column in columns))
    return tips, np.concatenate(rows), np.concatenate(numbers)


def _fields(
    motion: NeedleMotion, k: int, head: Head, part: Pieces, radius: FloatArray
) -> dict[str, NDArray[Any]]:
    """Of `Tips`, what one head alone says."""
    row, passes = part.row, head.passes
    start, end = part.places(head.tips)
    vessel, thick, along = _roles(motion, head, radius)
    along_of = np.repeat(along[row][:, :, None], 2, axis=2)
    written = (motion.writes & (motion.tool == k))[row]
    along_of[written, 0] = part.values(head.along)[written]
    return {
        "start": start,
        "end": end,
        "needle": np.full(len(row), k),
        "run": passes.run[row],
        "arc": part.values(passes.arc),
        "vessel": vessel[row],
        "radius": thick[row],
        "along": along_of,
        "since": np.stack([part.values(passes.since), part.values(passes.until)], axis=1),
    }


def _kept(tips: FloatArray) -> NDArray[np.bool_]:
    """Rows in which a tip moves, or stands elsewhere than before: a head that was lowered."""
    if not len(tips):
        return np.zeros(0, np.bool_)
    jumped = np.append(True, np.abs(tips[1:, 0] - tips[:-1, 1]).max(axis=1) > 0)
    return np.asarray(jumped | (np.abs(tips[:, 1] - tips[:, 0]).max(axis=1) > 0))


def _roles(
    motion: NeedleMotion, head: Head, radius: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Vessel, filament's radius and place along it, (n, 2) each: left (or written), and gone to."""
    last, following = head.passes.last, head.passes.next
    written = (last >= 0) & (last == following)
    following = np.where(written, NONE, following)
    vessel = np.column_stack(
        [np.where(rows >= 0, motion.vessel[rows], NONE) for rows in (last, following)]
    )
    thick = np.column_stack([radius[last], radius[following]])
    along = np.column_stack([head.along[last, 1], head.along[following, 0]])
    return vessel, thick, along
