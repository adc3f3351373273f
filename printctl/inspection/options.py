"""Tolerances and rate of false findings of a look at a layer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from printctl.inspection.inputs import check_number

IN_PART: Final = "at one end against the other"
"""End of a message on a move of one part of a picture."""

GAP_LIMITS_MM: Final = (0.02, 20)
WIDTH_LIMITS_PERCENT: Final = (1, 100)
"""Limits of tolerances, here and in a recipe."""
SHIFT_LIMITS_MM: Final = (0.01, 10)
"""Limits of the search, which goes twice as far as a recipe tolerates."""
FALSE_RATE_LIMITS: Final = (1e-9, 0.5)


@dataclass(frozen=True)
class SeeingOptions:
    """Tolerances of a look at a layer, and its rate of false findings.

    Attributes
    ----------
    gap_mm : float, mm
        Gaps from this length on are looked for.
    width_percent : float, %
    shift_mm : float, mm
        Farthest that the layer is looked for beside its place.
    false_rate : float
        False findings of each kind per sound layer, at most.
    round_lines : bool
        Whether lines are as high as wide: seen aslant they are wider than flat ones.
    """

    gap_mm: float = 0.2
    width_percent: float = 15.0
    shift_mm: float = 0.5
    false_rate: float = 2e-4
    round_lines: bool = False

    def __post_init__(self) -> None:
        check_number(self.gap_mm, "gap_mm", GAP_LIMITS_MM, "mm")
        check_number(self.width_percent, "width_percent", WIDTH_LIMITS_PERCENT, "%")
        check_number(self.shift_mm, "shift_mm", SHIFT_LIMITS_MM, "mm")
        check_number(self.false_rate, "false_rate", FALSE_RATE_LIMITS, "per layer")
