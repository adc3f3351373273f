"""Choose polygonal cross-sections for round tubes: number of sides, equal area, domed caps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

FACET_TOLERANCE_MM = 0.001
"""Default greatest distance of a facet from its chord's arc, mm; far below any printed line."""

_LEAST_FACETS = 16
_LEAST_COARSE = 12


def facet_count(radius_mm: float, tolerance_mm: float, least: int = _LEAST_FACETS) -> int:
    """Sides of the polygon whose sagitta r (1 - cos(π/n)) is at most ``tolerance_mm``.

    A multiple of four (so that circles reach their extremes along both axes), at least ``least``.
    """
    ratio = min(tolerance_mm / radius_mm, 1.0)
    wanted = math.pi / math.acos(1.0 - ratio)
    return max(least, 4 * math.ceil(wanted / 4.0))


@dataclass(frozen=True)
class Facets:
    """How near to its arc a facet lies: the greater of a length and a share of the radius.

    Attributes
    ----------
    tolerance_mm : float, mm
    ratio : float
        Of the radius there; 0 for the length alone.
    """

    tolerance_mm: float = FACET_TOLERANCE_MM
    ratio: float = 0.0

    def at(self, radius_mm: float) -> float:
        """Tolerance at a radius, mm."""
        return max(self.tolerance_mm, self.ratio * radius_mm)

    def count(self, radius_mm: float) -> int:
        """Sides of the polygon of a vessel of that radius."""
        least = _LEAST_COARSE if self.ratio else _LEAST_FACETS
        return facet_count(radius_mm, self.at(radius_mm), least)


def area_factor(facets: int) -> float:
    """Circumradius over radius, for which the polygon's area is that of the circle.

    A regular n-gon of circumradius R has the area (n/2) R² sin(2π/n); set it to π r². Inscribed
    polygons of 16 sides lose 2.6 % of the area, and so 5 % of the conductance.
    """
    angle = 2.0 * math.pi / facets
    return math.sqrt(angle / math.sin(angle))


def inscribed_factor(facets: int) -> float:
    """Inradius of the area-correct polygon over the circle's radius (just below 1)."""
    return area_factor(facets) * math.cos(math.pi / facets)


def dome_profile(facets: int) -> tuple[np.ndarray, np.ndarray]:
    """Rings of a hemispherical cap on an area-correct polygon, of the hemisphere's volume.

    Returns
    -------
    across : (k,) float64
        Radius of each ring over that of the base ring (base excluded, apex, 0, included).
    along : (k,) float64
        Height over the base, over the sphere's radius. It is stretched a little along the axis,
        which takes the volume between rings, h/3 (A₀ + √(A₀A₁) + A₁), up to that of the half ball.
    """
    angle = np.linspace(0.0, math.pi / 2, facets // 4 + 1)
    across, along = np.cos(angle), np.sin(angle)
    across[-1] = 0.0
    lower, upper = across[:-1], across[1:]
    volume = np.sum(np.diff(along) * (lower**2 + lower * upper + upper**2)) / 3.0
    return across[1:], along[1:] * (2.0 / 3.0) / volume
