"""Decide if a gap surely shows bare bath, or may be debris about as bright as the bath."""

from __future__ import annotations

from typing import Final

import numpy as np

from kernels.arrays import BoolArray, IntArray
from registration.inspection.gaps.between_older import BARE
from registration.inspection.ink.ink_image import ACROSS, CORE
from registration.inspection.ink.told import Told
from registration.inspection.pictures.working import Mask
from registration.inspection.values import FloatImage, Gap, Unseen
from registration.inspection.ways import Seen, Ways

_LEFT: Final = np.abs(ACROSS - 0.325) < 0.075
"""A line's flank: bare as well where ink is missing, not beside a crumb on the line."""
_MIDDLE: Final = np.abs(ACROSS) < 0.25
_FLANK_INK: Final = 0.45
"""Of the flank's usual level, from which on ink is seen there."""
_FLANK_SOME: Final = 0.15
_NO_CRUMB: Final = 2.0
"""Widths, from which on a gap in faint ink is longer than a crumb of the bath's brightness."""
_MOST_UNLIKE: Final = 90
"""Percentile of a gap's core that must look like bath."""
_LEAST_CLEAR: Final = 0.15
"""Of a gap's core, away from older ink, that its surface is judged by; else all of it is."""
_AROUND: Final = 0.3
"""In widths from a doubtful gap: so far it isn't clear either."""


def is_bare(
    gap: Gap, ways: Ways, seen: Seen, shown: BoolArray, told: Told, near_old: Mask, why: IntArray
) -> bool:
    """Whether a gap surely shows bath, over the line's whole width; marks others as unclear.

    Parameters
    ----------
    gap : Gap
    ways : Ways
    seen : Seen
        Of the places of ``ways``.
    shown : (n,) bool
        Where the line's place itself is seen.
    told : Told
        Ink told by its level; by its edges alone a line has no flanks to look at.
    near_old : (h, w) uint8
        Older ink and its edges, which don't look like bath where the line is missing either.
    why : (n,) int64
        `Unseen`, changed where it isn't clear.
    """
    own = (ways.stroke == gap.stroke) & (ways.along > gap.from_mm) & (ways.along < gap.to_mm)
    rows = np.flatnonzero(own & shown)
    if not len(rows) or told.noise is None:
        return True
    here = Seen(seen.at[rows], seen.across[rows], seen.along[rows])
    across = ways.width[rows, None] * ACROSS[CORE]
    core = here.profiles(told.unlike_bath, across)
    clear = here.profiles(near_old, across, nearest=True) == 0
    if clear.mean() > _LEAST_CLEAR:
        core = core[clear]
    alike = float(np.percentile(core, _MOST_UNLIKE)) < 1.0
    if not clear.any() and not shown[own].all():
        # Debris as bright as the bath would have to fill the slots between several older lines.
        alike = float(np.abs(told.present[rows]).max()) < BARE * told.noise.middle
    crossed = bool(ways.crossed[rows].any())
    width = float(ways.width[rows].max())
    if told.faint and gap.length_mm > _NO_CRUMB * width:  # noise alone would show ink on a flank
        flanked = False
    else:
        flanked = not told.template.by_edges and _flanked(told, told.profiles[rows], crossed)
    if alike and not flanked:
        return True
    around = _AROUND * width
    near = (ways.along > gap.from_mm - around) & (ways.along < gap.to_mm + around)
    why[near & (ways.stroke == gap.stroke) & (why == Unseen.SEEN)] = int(Unseen.UNCLEAR)
    return False


def _flanked(told: Told, profiles: FloatImage, crossed: bool) -> bool:
    """Whether ink is seen to a side where least of it is seen in the middle.

    Where another line or the line's other arm crosses, it may lie on one flank: then some ink must
    be seen on both.
    """
    depth = profiles[:, _MIDDLE].mean(axis=1)
    deepest = profiles[np.argsort(depth)[: max(1, len(depth) // 2)]].mean(axis=0)
    usual = told.template.values
    less, more = sorted(deepest[z].mean() / usual[z].mean() for z in (_LEFT, _LEFT[::-1]))
    return bool(more > _FLANK_INK and (less > _FLANK_SOME or not crossed))
