"""Scatter of ink in looks at little way, where a gap is a large part of it.

Of a vessel of 1 mm a gap leaves ten or twenty places with ink, and those at its rims make the rest
seem to scatter. So places around what looks bare are left out, and ink scatters at least as much as
the bath beside it: speckle and grain are of the device and the bath, and the same in both.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray
from registration.inspection.ink.presence import (
    INK,
    WINDOWS,
    WindowNoise,
    averaged,
    spread_of,
    widened,
    window_means,
)
from registration.inspection.ways import Ways

SHORT: Final = 12.0
"""Tolerated gaps: looks at less way are judged so."""
_RIM: Final = 0.5
"""Of a width, beside what looks bare: ink that ends round, and is blurred."""
_FEWEST: Final = 6
_OF_BATH: Final = 1.5
"""Times the bath's, that ink scatters at least: 0.3 to 1.3 in sound scans of scattering baths."""
_EVENEST: Final = 0.05
"""Of its presence: no ink lies more evenly."""
_TOGETHER: Final = 8
"""Places of a line that is laid over bath."""


def short_noise(
    present: FloatArray, good: BoolArray, ways: Ways, bath: FloatArray, gap_mm: float
) -> WindowNoise | None:
    """Measure it; None where next to no ink is left.

    Parameters
    ----------
    present : (n,) float64
    good : (n,) bool
        Seen.
    ways : Ways
    bath : (k,) float64
        Presence of bath, eight places a line.
    gap_mm : float, mm
        Tolerated gap.
    """
    ink = _clear_of_bare(present, good, ways, gap_mm)
    if ink.sum() < _FEWEST:
        return None
    middle, step = float(np.median(present[ink])), float(np.median(ways.step))
    lines = bath.reshape(-1, _TOGETHER)
    lengths, spreads = list[float](), list[float]()
    own = widened(spread_of(present[ink]), int(ink.sum()))
    for size in WINDOWS:
        count = max(1, round(size * gap_mm / step))
        means = window_means(present, ink, ways.run, count, scattered=False)
        if len(means) >= _FEWEST:
            own = min(own, widened(spread_of(means), len(means)))
        beside = spread_of(lines[:, :count].mean(axis=1))
        lengths.append(count * step)
        spreads.append(max(own, _OF_BATH * beside, _EVENEST * middle))
    bath_spread = spread_of(lines[:, : max(1, round(gap_mm / step))].mean(axis=1))
    return WindowNoise(
        np.array(lengths), middle, np.minimum.accumulate(np.array(spreads)), bath_spread
    )


def _clear_of_bare(present: FloatArray, good: BoolArray, ways: Ways, gap_mm: float) -> BoolArray:
    """Good places with ink, away from what looks bare over a tolerated gap, (n,)."""
    step = float(np.median(ways.step))
    around = averaged(present, good, ways.run, max(1, round(gap_mm / step)) | 1)
    ink = good & (present > INK)
    if not ink.any():
        return ink
    bare = good & (around < INK * float(np.median(present[ink])))
    reach = max(1, round(_RIM * float(np.median(ways.width)) / step))
    near = bare.copy()
    for by in range(1, reach + 1):
        near[by:] |= bare[:-by] & (ways.run[by:] == ways.run[:-by])
        near[:-by] |= bare[by:] & (ways.run[by:] == ways.run[:-by])
    return good & ~near
