"""Flow by the widths of the last picture alone, and whether it is likely to be off.

What surely is off is corrected (`flow_control`). Widths that light, rims or dim flanks make unsure
tell less: a flow that is likely off is asked about. Likely is what exceeds the tolerance and either
the picture's own uncertainty or, since pictures misread alike, that of the change since the print's
first picture. Once it was asked about, only such a change since then is asked about again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from kernels.arrays import FloatArray

_LIKELY: Final = 2.0
"""Standard uncertainties of a level: one print in twenty that is known no better is asked about (of
a stranger's 26 sound ones 3, by 1.5 it were 5)."""
_KNOWN: Final = 0.075
"""Uncertainty of a level, below which a flow that is 30 % off is corrected without being asked."""
_CHANGED: Final = 3.0
"""The same of a change."""
_OWN: Final = 0.1
"""Of what a picture misreads of all lines alike, as a variance: the next one doesn't."""
_PICTURE: Final = 0.015
"""What pictures misread differently beyond what they state, relative."""


@dataclass(frozen=True)
class SeenLevel:
    """Logarithm of delivered over asked flow, without correction.

    Attributes
    ----------
    level : float
    variance : float
        Of it, without what all readings of a picture share.
    common : float
        What they share, relative.
    """

    level: float
    variance: float
    common: float

    @property
    def u(self) -> float:
        """Standard uncertainty."""
        return math.hypot(math.sqrt(self.variance), self.common)

    def u_change(self, other: SeenLevel) -> float:
        """Standard uncertainty of the difference to another picture's."""
        own = _OWN * (self.common**2 + other.common**2) + (self.common - other.common) ** 2
        return math.sqrt(self.variance + other.variance + own + 2 * _PICTURE**2)


@dataclass
class SeenFlow:
    """What pictures alone say of the flow.

    Attributes
    ----------
    first, last : SeenLevel or None
        Of the print's first and last picture that told any width.
    asked : SeenLevel or None
        Of the picture that the operator was asked about last.
    """

    first: SeenLevel | None = None
    last: SeenLevel | None = None
    asked: SeenLevel | None = None

    def learn(self, readings: FloatArray, variance: FloatArray, common: float) -> None:
        """Take in a picture's readings, (n,), in their order: the later half tells what flows."""
        if not len(readings):
            return
        late = slice(len(readings) // 2, None)
        count = len(readings[late])
        level, random = float(readings[late].mean()), float(variance[late].mean()) / count
        self.last = SeenLevel(level, random, common)
        self.first = self.first or self.last

    def likely_off(self, factor: float, tolerance: float) -> bool:
        """Whether the flow by a factor in force is likely off by more than a share."""
        if self.first is None or self.last is None or self.last.u < _KNOWN:
            return False
        least, left = math.log1p(tolerance), abs(self.last.level + math.log(factor))
        before = self.asked or self.first
        changed = abs(self.last.level - before.level)
        surely = changed > max(least, _CHANGED * self.last.u_change(before))
        likely = self.asked is None and left > _LIKELY * self.last.u
        return left > least and (likely or surely)
