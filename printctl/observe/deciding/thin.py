"""Data class of a line's thin stretch; keep those that a second picture confirms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Thin:
    """Stretch of a path with too little ink.

    Attributes
    ----------
    stroke : int
        Number of the path.
    from_mm, to_mm : float, mm
        Along it.
    missing : float
        Share of the ink that was asked for, 0 to 1.
    """

    stroke: int
    from_mm: float
    to_mm: float
    missing: float

    @property
    def length_mm(self) -> float:
        """Along the path."""
        return self.to_mm - self.from_mm


def seen_twice(first: Sequence[Thin], second: Sequence[Thin]) -> tuple[Thin, ...]:
    """Return those of the first picture of which the second shows half at least."""
    return tuple(one for one in first if 2 * _common_mm(one, second) >= one.length_mm)


def _common_mm(one: Thin, others: Sequence[Thin]) -> float:
    own = [other for other in others if other.stroke == one.stroke]
    each = (min(one.to_mm, other.to_mm) - max(one.from_mm, other.from_mm) for other in own)
    return sum(max(0.0, length) for length in each)
