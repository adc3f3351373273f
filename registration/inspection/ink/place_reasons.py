"""Say why places along lines aren't seen: strange things, what is hidden, the picture's border."""

from __future__ import annotations

import numpy as np

from kernels.arrays import BoolArray, IntArray
from registration.inspection.pictures.working import Working
from registration.inspection.values import Unseen
from registration.inspection.ways import Seen, Ways

_HIT = 0.2
"""Of a place's width that must be strange or hidden for it not to be seen."""
_EDGE, _CORE = 0.5, 0.3
"""Widths from the middle of a line: to its edge, and of what presence is told by."""


def reasons(
    work: Working, seen: Seen, ways: Ways, strange: BoolArray, by_hidden: bool = True
) -> IntArray:
    """Why each place isn't seen, (n,); what is hidden counts unless not ``by_hidden``."""
    why = np.full(len(ways), int(Unseen.SEEN))
    # Heights fall steeply at a line's edges, where a profiler loses points: its middle tells.
    each = [(strange, Unseen.GLARE, _EDGE)]
    if by_hidden:
        each.append((work.hidden, Unseen.HIDDEN, _EDGE if work.height is None else _CORE))
    for mask, reason, reach in each:
        across = ways.width[:, None] * np.linspace(-reach, reach, 9)
        hit = seen.profiles(mask.astype(np.uint8), across, nearest=True).mean(axis=1)
        why[hit > _HIT] = int(reason)
    why[~seen.inside(work.shape, 0.5 * ways.width)] = int(Unseen.OUTSIDE)
    return np.asarray(why)
