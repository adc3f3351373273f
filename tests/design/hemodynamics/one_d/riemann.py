"""The exact solution of a uniform elastic tube's Riemann problem: two waves, α = 1, no friction.

Across a rarefaction u ± 4c is kept; across a shock mass and momentum, u - u₀ = ∓√((A - A₀)
(Φ - Φ₀)/(A A₀)) with Φ = ∫c² dA = c²A·⅔ (c² ~ √A).
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq


@dataclass(frozen=True)
class Side:
    """One of the two states: area and velocity."""

    area: float
    velocity: float


@dataclass(frozen=True)
class Riemann:
    """c² = ``k`` √A."""

    left: Side
    right: Side
    k: float

    def speed(self, area: float) -> float:
        return float(np.sqrt(self.k * np.sqrt(area)))

    def _phi(self, area: float) -> float:
        return 2.0 / 3.0 * self.k * area**1.5

    def _jump(self, area: float, side: Side) -> float:
        if area <= side.area:
            return 4.0 * (self.speed(area) - self.speed(side.area))
        gained = (area - side.area) * (self._phi(area) - self._phi(side.area))
        return float(np.sqrt(gained / (area * side.area)))

    def middle(self) -> Side:
        """The state between the waves."""

        def gap(area: float) -> float:
            jumps = self._jump(area, self.left) + self._jump(area, self.right)
            return jumps + self.right.velocity - self.left.velocity

        area = brentq(gap, 1e-6 * self.left.area, 100.0 * self.left.area, xtol=1e-14, rtol=1e-14)
        return Side(area, self.left.velocity - self._jump(area, self.left))

    def at(self, slope: float) -> Side:
        """The state along x/t = ``slope``."""
        middle = self.middle()
        if slope > middle.velocity:
            mirror = Riemann(
                Side(self.right.area, -self.right.velocity),
                Side(self.left.area, -self.left.velocity),
                self.k,
            )
            found = mirror._left_wave(-slope, Side(middle.area, -middle.velocity))
            return Side(found.area, -found.velocity)
        return self._left_wave(slope, middle)

    def _left_wave(self, slope: float, middle: Side) -> Side:
        side = self.left
        if middle.area > side.area:
            moved = middle.area * middle.velocity - side.area * side.velocity
            return side if slope < moved / (middle.area - side.area) else middle
        if slope < side.velocity - self.speed(side.area):
            return side
        if slope > middle.velocity - self.speed(middle.area):
            return middle
        # Inside the fan u - c = slope and u + 4c is the left state's.
        c = (side.velocity + 4.0 * self.speed(side.area) - slope) / 5.0
        return Side((c * c / self.k) ** 2, slope + c)
