"""Select designed voids near a mend that must stay ink-free, not those that the job fills."""

from __future__ import annotations

from typing import Final

import numpy as np

from kernels.arrays import FloatArray
from printctl.observe.mending.held_print import HeldPrint
from printctl.observe.mending.laid_ink import laid_ink, nearest_pieces
from printctl.observe.mending.voids import Voids
from printctl.observe.mending.written_paths import written_paths

_ON_AXIS: Final = 0.5
"""Share of a void's radius within which a written axis is the void's own."""


def open_voids(voids: Voids, held: HeldPrint, places: FloatArray, reach_mm: float) -> Voids:
    """Return the voids near places (m, 3), mm, that ink must keep out of.

    An embedded print writes sacrificial ink where its lumens are to be, so a network's vessels are
    voids to it only where no path of the job, written or to come, goes along them.
    """
    if held.style == "layered" or not len(voids) or not len(places):
        return voids
    close = voids.near(places.min(axis=0) - reach_mm, places.max(axis=0) + reach_mm)
    planned = laid_ink(written_paths(held, len(held.lines)))
    own = np.ones(len(close), dtype=bool)
    for share in (0.1, 0.5, 0.9):
        axis = close.start + share * (close.end - close.start)
        own &= nearest_pieces(axis, planned)[1] <= _ON_AXIS * close.radius.mean(axis=1)
    return close.where(~own)
