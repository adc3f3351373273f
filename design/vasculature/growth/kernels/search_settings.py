"""Settings of the search for a new terminal's place, of its radii and of its spacing."""

from __future__ import annotations

from typing import NamedTuple


class PlaceSearch(NamedTuple):
    """How thoroughly the bifurcation of a new terminal is searched for."""

    nearest: int = 10
    many_nearest: int = 40
    """Segments considered; more for given points missed at first, or with a flow ratio."""
    retried: int = 4
    """Of these the cheapest, for which other places than the best are tried."""
    weiszfeld_steps: int = 8
    """At most."""
    axis_places: int = 7
    """Places tried along a segment that mustn't bend, before the best is refined."""
    halvings: int = 8
    """Steps in which a place is refined."""


class PredictedRadii(NamedTuple):
    """How the finished tree's radii are predicted while it grows."""

    refresh_divisor: int = 24
    """Radii are derived anew each time the tree has grown by one in so many terminals."""
    growth_power: float = 0.02
    """Power of the number of terminals with which the root's radius grows (measured)."""
    widening_reserve: float = 0.02
    """A vessel must be able to become this part wider than predicted to take on more terminals,
    times the part of the tree that has yet to grow: at the end the prediction is exact, and a
    trunk that is as wide as it can be would close all of its branches."""
    thin_margin: float = 1.08
    """A new terminal must be this much wider than the limit: later ones make it thinner."""


class TerminalSpacing(NamedTuple):
    """Distance of a new terminal from the tree, over the terminals' mean spacing."""

    most: float = 0.9
    """At first, and at most."""
    relax: float = 0.93
    tighten: float = 1.01
    """Factors after points without a place, and after one with."""
    thin_patience: int = 6
    wide_patience: int = 400
    """`Scale.patience` of thin trees, which get everywhere at once, and of those with a
    smallest radius: with that of the former, 95 % of a folded slab lay within 7.9 mm of a
    lumen, not 1.9."""


SEARCH, RADII, SPACING = PlaceSearch(), PredictedRadii(), TerminalSpacing()
