"""Tolerances of a look at a layer, and how often a sound one may be faulted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

IN_PART: Final = "at one end against the other"
"""How words on a move end that one part of a picture shows alone."""


@dataclass(frozen=True)
class SeeingOptions:
    """Tolerances of a look, and how often a sound layer may be faulted.

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
