"""Print set-up data: mounted printer, needle, syringe, ink, dish, bath; and check results.

The checks themselves, which look at G-code, are in `printctl.checks.preflight`.

Goes in: names of profiles. Comes out: a `SetUp`. Begin with `mounted.py`.
"""

from printctl.checks.set_up.budget import Budget, budget_of
from printctl.checks.set_up.check import Check, placed_failures, refuse_failed, warnings
from printctl.checks.set_up.mounted import HeadLoading, SetUp
from printctl.checks.set_up.placed_dish import (
    ABOVE_WALL_MM,
    WALL_CLEARANCE_MM,
    PlacedDish,
    hub_gap_of,
    wall_gap_of,
)

__all__ = [
    "ABOVE_WALL_MM",
    "WALL_CLEARANCE_MM",
    "Budget",
    "Check",
    "HeadLoading",
    "PlacedDish",
    "SetUp",
    "budget_of",
    "hub_gap_of",
    "placed_failures",
    "refuse_failed",
    "wall_gap_of",
    "warnings",
]
