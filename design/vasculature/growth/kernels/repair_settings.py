"""Settings of the repair of trees whose segments are wider than their surroundings allow."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

MUST_GO = -1.0
"""Allowed radius of a branch that must go as a whole."""
GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


class RepairSettings(NamedTuple):
    """How branches that don't fit are thinned out, and their tips moved."""

    thinning_factor: float = 0.98
    """Part of the allowed radius that a segment is thinned out to: regrowth widens other
    paths."""
    min_terminals: int = 4
    """Left by thinning out; a branch with fewer is taken away."""
    tip_directions: int = 48
    """Tried for a new tip, spread over the sphere."""
    tip_lengths: tuple[float, float, float] = (1.0, 0.7, 0.4)
    """Tried in each direction, over the branch's length."""


REPAIR = RepairSettings()
