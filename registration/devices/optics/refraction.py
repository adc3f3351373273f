"""Refraction at the sample's surface by Snell's law, and the error of a straight ray."""

from __future__ import annotations

import math

import numpy as np

from kernels.arrays import FloatArray
from registration.errors import RegistrationError


def refract(direction: FloatArray, normal: FloatArray, index: float) -> FloatArray:
    """Unit directions of light that enters a medium from air.

    Vector form of Snell's law: with c = -n·d, r = 1/index, d' = r d + (r c - √(1 - r²(1 - c²))) n.

    Parameters
    ----------
    direction : (..., 3) float64
        Unit directions in air.
    normal : (..., 3) float64
        Unit normals of the surface, towards the air.
    index : float
        Of the medium over that of air.

    Returns
    -------
    (..., 3) float64
        Unit directions in the medium.
    """
    ratio = 1 / index
    cosine = -np.sum(direction * normal, axis=-1, keepdims=True)
    inside = np.sqrt(1 - ratio**2 * (1 - cosine**2))
    bent: FloatArray = ratio * direction + (ratio * cosine - inside) * normal
    return bent


def refraction_bound(tilt_deg: float, depth_mm: float, index: float) -> tuple[float, float]:
    """How far a point lies from where a straight vertical ray would put it.

    Below a flat surface tilted by θ light runs at δ = θ - asin(sin θ / n) from the vertical, so
    that a geometric path ℓ ends ℓ sin δ aside and ℓ (1 - cos δ) too high (Westphal et al. 2002,
    Opt. Express 10, 397).

    Parameters
    ----------
    tilt_deg : float, degrees
        Of the surface, below 90.
    depth_mm : float, mm
        Geometric path below the surface.
    index : float
        Of the sample.

    Returns
    -------
    aside, up : float, mm

    Raises
    ------
    RegistrationError
        When tilt or index is impossible.
    """
    if not (0 <= tilt_deg < 90 and index >= 1):
        raise RegistrationError(
            f"tilt {tilt_deg:g}° must lie in 0 to 90 and index {index:g} be at least 1"
        )
    tilt = math.radians(tilt_deg)
    turned = tilt - math.asin(math.sin(tilt) / index)
    return depth_mm * math.sin(turned), depth_mm * (1 - math.cos(turned))
