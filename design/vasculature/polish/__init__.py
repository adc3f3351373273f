"""Optimise a grown tree afterwards: move branch points and branches to lower its cost.

Goes in: a grown tree, or several of one tissue. Comes out: the same terminals at less cost. Begin
with `polish.py`.
"""

from design.vasculature.polish.cost import tree_volume
from design.vasculature.polish.options import PolishOptions
from design.vasculature.polish.polish import (
    Faults,
    PolishedTree,
    find_faults,
    polish,
    polish_forest,
)

__all__ = [
    "Faults",
    "PolishOptions",
    "PolishedTree",
    "find_faults",
    "polish",
    "polish_forest",
    "tree_volume",
]
