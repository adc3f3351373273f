"""Options of polishing (optimising after growth) a tree: limits, rounds, tolerance."""

from __future__ import annotations

from dataclasses import dataclass, fields

from design.errors import GrowthError
from design.vasculature.limits import check_angles


@dataclass(frozen=True)
class PolishOptions:
    """Options of polishing a tree.

    Attributes
    ----------
    seed : int
        Of the order in which branches are tried; same seed, tree and tissue, same result.
    length_exponent, radius_exponent : float
        u and λ of the cost Σ ℓᵘ r^λ that is lowered; 1 and 2 make it the volume.
    clearance_mm, clearance_ratio, length_to_radius : float
    branch_angle_degrees, turn_angle_degrees : (float, float)
    flow_ratio : float
        As in `GrowthOptions`; give what the tree was grown with.
    rounds : int
        Rounds of grafting, each followed by relaxation; 0 relaxes only.
    heat : float
        By how much a graft may raise the cost in the first round, over the mean cost of a segment.
        It falls with the rounds (threshold accepting: Dueck & Scheuer 1990, doi
        10.1016/0021-9991(90)90201-B), to 0 in the last three. With 0 from the start the cost falls
        at every move, and ends higher.
    sweeps : int
        Sweeps over all branch points in one relaxation, at most.
    tolerance : float
        A relaxation, or the rounds, end when the last one lowered the cost by less than this
        part.
    """

    seed: int = 1
    length_exponent: float = 1.0
    radius_exponent: float = 2.0
    clearance_mm: float = 0.0
    clearance_ratio: float = 0.1
    length_to_radius: float = 1.0
    branch_angle_degrees: tuple[float, float] = (0.0, 180.0)
    turn_angle_degrees: tuple[float, float] = (0.0, 180.0)
    flow_ratio: float = 0.0
    rounds: int = 24
    heat: float = 1.0
    sweeps: int = 12
    tolerance: float = 1e-3

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, tuple):
                check_angles(field.name, value)
                continue
            low, high = _LIMITS[field.name]
            if not low <= value <= high:
                raise GrowthError(
                    f"polish: {field.name} is {value:g}; give a value from {low:g} to {high:g}"
                )


_LIMITS: dict[str, tuple[float, float]] = {
    "seed": (0, 2**63),
    "length_exponent": (0.25, 4.0),
    "radius_exponent": (0.25, 4.0),
    "clearance_mm": (0.0, 10.0),
    "clearance_ratio": (0.0, 10.0),
    "length_to_radius": (0.0, 100.0),
    "flow_ratio": (0.0, 0.5),
    "rounds": (0, 1000),
    "heat": (0.0, 100.0),
    "sweeps": (1, 1000),
    "tolerance": (0.0, 1.0),
}
