"""Options of the vessels that connect trees' terminals: clearance, bends, cost weights."""

from __future__ import annotations

from dataclasses import dataclass

from design.errors import GrowthError


@dataclass(frozen=True)
class LoopOptions:
    """Options of joining terminals.

    All connections get the same hydraulic resistance, r⁴ ~ length: with trees of equal terminal
    pressures every loop then carries the same flow.

    Attributes
    ----------
    seed : int
        Of the shapes tried beyond the first.
    clearance_mm, clearance_ratio : float
        As in `GrowthOptions`, between connections and everything, each other included. Trees
        grown with a little more leave room at their tips.
    bend_to_radius : float
        Least bend radius of a connection's axis over its lumen radius; at least 1.
    kink_degrees : float
        Largest angle between a terminal's vessel and the connection that continues it.
    radius_ratio : float
        Radius of a connection of typical length over the terminals' median radius.
    smallest_radius_mm : float, optional
        Instead: no connection is thinner.
    prune_part : float
        Part of the terminals that may be pruned, in pairs, where nothing joins them; more is an
        error.
    weight_length, weight_tortuosity, weight_clearance, weight_volume : float
        Of a candidate's length over the typical one, its length over its chord less 1, its lack
        of room (1 at none, 0 at four radii), and its volume over the typical one.
    """

    seed: int = 1
    clearance_mm: float = 0.0
    clearance_ratio: float = 0.1
    bend_to_radius: float = 2.0
    kink_degrees: float = 75.0
    radius_ratio: float = 0.75
    smallest_radius_mm: float | None = None
    prune_part: float = 0.01
    weight_length: float = 1.0
    weight_tortuosity: float = 0.5
    weight_clearance: float = 0.5
    weight_volume: float = 0.5

    def __post_init__(self) -> None:
        for name, low, high in _LIMITS:
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise GrowthError(f"{name} is {value:g}; give a value from {low:g} to {high:g}")


_LIMITS = (
    ("seed", 0, 2**63),
    ("clearance_mm", 0.0, 10.0),
    ("clearance_ratio", 0.0, 10.0),
    ("bend_to_radius", 1.0, 100.0),
    ("kink_degrees", 1.0, 85.0),
    ("radius_ratio", 0.1, 10.0),
    ("smallest_radius_mm", 1e-4, 10.0),
    ("prune_part", 0.0, 0.5),
    ("weight_length", 0.0, 1e3),
    ("weight_tortuosity", 0.0, 1e3),
    ("weight_clearance", 0.0, 1e3),
    ("weight_volume", 0.0, 1e3),
)
