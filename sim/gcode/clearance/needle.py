"""Needle shape for the shaft check: upright shaft, tip cone and hub around the tip's axis."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray
from sim.errors import ClearanceError


@dataclass(frozen=True)
class NeedleBody:
    """A vertical needle, a body of revolution about the line above its tip.

    Attributes
    ----------
    radius_mm : float, mm
        Outer radius of the shaft.
    tip_radius_mm : float or None, mm
        Outer radius at the tip, at most the shaft's; None for a blunt tube.
    cone_mm : float, mm
        Height over which the one grows to the other; 0 for a blunt tube.
    length_mm : float, mm
        From the tip to the hub; inf where nobody knows it.
    hub_radius_mm : float or None, mm
        Of the hub above the shaft; None where nobody knows it: the shaft then goes on.
    clearance_mm : float, mm
        To be kept between the shaft and what is written. Nearer is told, touching is a crossing.

    Raises
    ------
    ClearanceError
        For lengths that are none, or a tip wider than the shaft.
    """

    radius_mm: float
    tip_radius_mm: float | None = None
    cone_mm: float = 0.0
    length_mm: float = math.inf
    hub_radius_mm: float | None = None
    clearance_mm: float = 0.0

    def __post_init__(self) -> None:
        for name in ("radius_mm", "length_mm"):
            if not getattr(self, name) > 0:
                raise ClearanceError(f"needle: {name} is {getattr(self, name):g}; give more than 0")
        for name in ("cone_mm", "clearance_mm"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ClearanceError(f"needle: {name} is {getattr(self, name):g}; give 0 or more")
        tip = self.tip_radius_mm
        if tip is not None and not 0 <= tip <= self.radius_mm:
            raise ClearanceError(
                f"needle: tip_radius_mm {tip:g} isn't between 0 and the shaft's {self.radius_mm:g}"
            )
        if self.hub_radius_mm is not None and not self.hub_radius_mm >= self.radius_mm:
            raise ClearanceError(
                f"needle: hub_radius_mm {self.hub_radius_mm:g} is below the shaft's "
                f"{self.radius_mm:g}"
            )

    @property
    def tip_mm(self) -> float:
        """Outer radius at the tip, mm."""
        return self.radius_mm if self.tip_radius_mm is None else self.tip_radius_mm

    @property
    def widest_mm(self) -> float:
        """Largest radius anywhere, mm."""
        return self.radius_mm if self.hub_radius_mm is None else self.hub_radius_mm

    def as_row(self) -> FloatArray:
        """For `clearance.shaft_kernels.shaft_distance`: radius, tip, cone, length, hub."""
        tip, cone = self.tip_radius_mm, self.cone_mm
        if tip is None or cone == 0:
            tip, cone = self.radius_mm, 0.0
        length, hub = self.length_mm, self.hub_radius_mm
        if hub is None:
            length, hub = math.inf, self.radius_mm
        return np.array([self.radius_mm, tip, cone, length, hub], dtype=np.float64)
