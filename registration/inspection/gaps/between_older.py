"""Infer missing ink where a line crosses older ink, from bare bath on both sides of it.

Opaque ink can't be told from older ink of its own kind, and in a lattice of several layers most of
a line lies on that. Bath that is seen in the line's place between two older lines says that no ink
is there; where both sides of a narrow older line say so, none lies on it either. Ink to both sides
says less: a short gap may lie between.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.ink.presence import INK
from registration.inspection.values import Unseen
from registration.inspection.ways import Ways, stretches_of

_WIDEST: Final = 2.5
"""Of the line's width: older ink of that length along it is judged by what lies to its sides."""
_AT_END: Final = 2.0
"""The same at the end of a line, where there is one side."""
BARE: Final = 0.25
"""Of the usual presence of ink, below which a place is bare beyond doubt."""
_FEWEST: Final = 6
_CONTRADICTED: Final = 0.35
"""Of the older ink between places alike, that may be told otherwise before that is doubted."""


def infer_missing(
    present: FloatArray, seen: BoolArray, why: IntArray, ways: Ways, usual: float
) -> BoolArray:
    """Return places on older ink from which ink is missing as it is from both sides, (n,).

    Parameters
    ----------
    present : (n,) float64
        Presence of ink.
    seen : (n,) bool
        Places over bath at which it is told.
    why : (n,) int64
        `Unseen`.
    ways : Ways
    usual : float
        Presence of ink where there is some.
    """
    bare = seen & (present < BARE * usual)
    out = np.zeros(len(ways), dtype=np.bool_)
    for first, last in stretches_of(why == Unseen.OLD_INK, ways.run):
        sides = _sides(first, last, ways)
        widest = (_AT_END, _WIDEST)[len(sides) - 1] * float(ways.width[first : last + 1].min())
        length = float(ways.step[first : last + 1].sum())
        if sides and bare[sides].all() and length <= widest:
            out[first : last + 1] = True
    return out


def is_contradicted(
    on_old: FloatArray, told: BoolArray, present: FloatArray, seen: BoolArray, ways: Ways,
    usual: float,
) -> bool:  # fmt: skip
    """Whether what is told on older ink contradicts the bath beside it along the line.

    Where both sides show ink, or both are bare, older ink that is crossed in between mostly does so
    too: a few short gaps may lie on it, or single beads, but not over a third of its length.

    Parameters
    ----------
    on_old, told : (n,) float64 and bool
        Presence on older ink, and where it is told.
    present, seen : (n,) float64 and bool
        Presence over bath, and where that is told.
    ways : Ways
    usual : float
        Presence of ink over bath.
    """
    bare = seen & (present < BARE * usual)
    inked = seen & (present > (1.0 - BARE) * usual)
    wrong: dict[bool, list[BoolArray]] = {True: [], False: []}
    for first, last in stretches_of(told, ways.run):
        sides = _sides(first, last, ways)
        both_bare, both_inked = bare[sides].all(), inked[sides].all()
        if len(sides) == 2 and (both_bare or both_inked):
            wrong[bool(both_inked)].append((on_old[first : last + 1] > INK) != both_inked)
    return any(
        len(one) >= _FEWEST and np.concatenate(one).mean() > _CONTRADICTED for one in wrong.values()
    )


def _sides(first: int, last: int, ways: Ways) -> list[int]:
    """Places directly before and behind a stretch that are of its run."""
    n, run = len(ways), ways.run
    return [row for row in (first - 1, last + 1) if 0 <= row < n and run[row] == run[first]]
