"""Check a user's limits on branching angles and flow split; convert them for kernels."""

from __future__ import annotations

from math import cos, radians
from typing import NamedTuple

from design.errors import GrowthError


class Limits(NamedTuple):
    """Limits on joints, as compiled code takes them; angles by their cosines.

    Attributes
    ----------
    on : bool
        Whether there are any.
    narrow, wide : float
        Cosines of the least and the greatest angle between two children.
    slight, sharp : float
        The same of each child against its parent's way on.
    share : float
        Least flow of a child over its sibling's, 0 to 1.
    """

    on: bool
    narrow: float
    wide: float
    slight: float
    sharp: float
    share: float


def check_angles(name: str, angles: tuple[float, float]) -> None:
    """Refuse what isn't a least and a greatest angle.

    Raises
    ------
    GrowthError
    """
    if len(angles) != 2 or not 0.0 <= angles[0] < angles[1] <= 180.0:
        raise GrowthError(
            f"{name} is {tuple(angles)}; give a least and a greatest angle from 0 to 180 degrees"
        )


def joint_limits(
    branch_degrees: tuple[float, float], turn_degrees: tuple[float, float], flow_ratio: float
) -> Limits:
    """Limits in a user's words as compiled code takes them."""
    free = (0.0, 180.0)
    on = tuple(branch_degrees) != free or tuple(turn_degrees) != free or flow_ratio > 0.0
    narrow, wide, slight, sharp = (cos(radians(x)) for x in (*branch_degrees, *turn_degrees))
    return Limits(on, narrow, wide, slight, sharp, flow_ratio)
