"""Split values into two classes (gel and liquid) by the midpoint of their means."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray

APART = 2.9
"""Classes whose means lie so many of their standard deviations apart are two: one normal class
split at its mean has halves 2.65 apart."""


@dataclass(frozen=True)
class Levels:
    """Two classes of an averaged share.

    Attributes
    ----------
    low, high : float
        Their means.
    apart : float
        Distance of the means over the classes' standard deviation.
    """

    low: float
    high: float
    apart: float

    @property
    def two(self) -> bool:
        """Whether there are two classes at all."""
        return self.apart >= APART

    @property
    def middle(self) -> float:
        """Threshold between them."""
        return (self.low + self.high) / 2


def split_classes(values: FloatArray) -> Levels:
    """Split values into two classes at the middle of their means (Ridler & Calvard 1978).

    `skimage.filters.threshold_isodata` takes the lowest level of a histogram that fulfils this: on
    34 splits of five scans its 256 bins lie within 0.4 % of the step where contrast is good, but 1
    to 3 % lower, and once 8 % and 27 %, where it is poor; 4096 bins 0.4 % lower, and once 1.5 %
    higher.
    What takes time here, the classes' means and spread, is asked for anyway.
    """
    level = float(values.mean())
    for _ in range(100):
        above = values > level
        if above.all() or not above.any():
            return Levels(level, level, 0.0)
        low, high = float(values[~above].mean()), float(values[above].mean())
        if abs((low + high) / 2 - level) < 1e-4 * high:
            break
        level = (low + high) / 2
    spread = float(np.sqrt((values[~above].var() * (~above).sum() + values[above].var()
                            * above.sum()) / len(values)))  # fmt: skip
    return Levels(low, high, (high - low) / max(spread, 1e-9))
