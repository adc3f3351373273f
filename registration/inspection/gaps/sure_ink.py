"""Places at which the picture rules out a tolerated gap: what isn't surely ink isn't seen.

A stretch whose presence is low, but not so low that noise alone is next to impossible, is no gap
that may be told of, nor is it ink. It is seen only where a gap would be found, nineteen times in
twenty, and where presence is above what a gap would show, as often. Gaps of the tolerated length
beside turns show up to half of what ink does: so little is ink's only where noise explains it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray
from registration.inspection.gaps.gaps import LEAST
from registration.inspection.ink.presence import INK, WindowNoise, averaged
from registration.inspection.ways import Ways

_Z: Final = 1.64
"""Standard deviations that a bare stretch exceeds once in twenty times."""
_RARE: Final = 1e-3
"""Chance by noise of presence as low as a stretch's, below which it isn't taken for ink."""
_LOW: Final = 0.75
"""Of ink's usual presence, below which places next to such a stretch belong to it."""


def unsure_places(
    present: FloatArray,
    good: BoolArray,
    ways: Ways,
    noise: WindowNoise,
    gap_mm: float,
    p_needed: float,
    strength: FloatArray,
) -> BoolArray:
    """Return good places of stretches that might be gaps of ``gap_mm``, (n,).

    Parameters
    ----------
    present : (n,) float64
    good : (n,) bool
        Seen, and told from its background.
    ways : Ways
    noise : WindowNoise
        Of presence where ``strength`` is 1.
    gap_mm : float, mm
        Tolerated gap.
    p_needed : float
        A gap's p-value must be below.
    strength : (n,) float64
        Of what shows a line, over the usual: presence scatters as much more.
    """
    step = float(np.median(ways.step))
    whole, bare = (max(1, round(size * gap_mm / step)) | 1 for size in (1.0, LEAST))
    evened = noise.middle + strength * (present - noise.middle)
    gap = noise.middle * (1.0 - averaged(strength, good, ways.run, whole)) + _Z * noise.bath
    untold = noise.p_values(gap, gap_mm) > p_needed
    # Ends reach into a gap, so that its middle alone shows none.
    mean, share = (averaged(one, good, ways.run, bare) for one in (evened, strength))
    scatter = noise.middle / max(noise.contrast(LEAST * gap_mm), 1e-9)
    like_gap = mean < noise.middle * (1.0 - share) + _Z * scatter
    shown = averaged(present, good, ways.run, bare)
    unlike_ink = (shown < INK * noise.middle) & (noise.p_values(mean, LEAST * gap_mm) < _RARE)
    low = present < _LOW * noise.middle
    return good & (
        (_spread(good & unlike_ink, ways, whole // 2) & low)
        | _spread(good & untold, ways, whole // 2)
        | _spread(good & like_gap, ways, bare // 2)
    )


def _spread(flags: BoolArray, ways: Ways, reach: int) -> BoolArray:
    """Flags of places, spread to so many neighbours of the same run to both sides, (n,)."""
    out = flags.copy()
    for by in range(1, reach + 1):
        same = ways.run[by:] == ways.run[:-by]
        out[by:] |= flags[:-by] & same
        out[:-by] |= flags[by:] & same
    return out
