"""Find a liver's porta hepatis (vessel entry) and hepatic vein exit from surface samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.anatomy.openness import SurfaceSamples
from design.errors import TissueError
from kernels.arrays import FloatArray

_PORTA = 0.03
"""Share of the surface, the least open of it, in whose middle the porta hepatis lies."""

_GROOVES = 0.15
"""Share of the surface, the least open of it, that all grooves have; the vena cava's is one."""

_CONVEX = 0.95
"""Openness above which a place lies in no groove."""

_NEAREST, _FARTHEST = 0.35, 1.0
"""Way from the porta to the vena cava over the cube root of the liver's volume."""

_TOP = 0.04
"""Share of the grooves, the highest of them, whose middle is where the hepatic veins leave."""


@dataclass(frozen=True)
class LiverPlaces:
    """Places of a liver.

    Attributes
    ----------
    porta, porta_inward : (3,) float64
        Where portal vein and hepatic artery enter, mm; and which way, a unit vector.
    cava, cava_inward : (3,) float64
        Where the hepatic veins leave to the vena cava, and the way into the liver there.
    up : (3,) float64
        Unit vector from the visceral side to the diaphragm.
    """

    porta: FloatArray
    porta_inward: FloatArray
    cava: FloatArray
    cava_inward: FloatArray
    up: FloatArray


def find_liver_places(
    samples: SurfaceSamples,
    volume_mm3: float,
    porta: FloatArray | None = None,
    cava: FloatArray | None = None,
) -> LiverPlaces:
    """Find the porta in the middle of the visceral side's hollow, the veins' exit above it.

    The hollow is where the surface is least open, and what it opens to is below. Of all grooves
    that aren't at the porta, the vena cava's reaches highest. In the one liver that was at hand
    with its vessels, both places lay within 14 mm of the true ones.

    Parameters
    ----------
    volume_mm3 : float
        Of the liver.
    porta, cava : (3,) float64, mm, optional
        Near where these are, in place of what the shape tells.

    Raises
    ------
    TissueError
        Where the surface is as open everywhere, or has no groove above the porta.
    """
    openness, points = samples.openness, samples.points
    hollow = openness <= np.quantile(openness, _PORTA)
    if hollow.mean() > 0.5 and (porta is None or cava is None):
        raise TissueError(
            "no porta hepatis is found: the surface is as open everywhere; give both places "
            "(anatomy: {inlets: {porta_hepatis: {at_mm: [x, y, z]}, vena_cava: ...}})"
        )
    inside = np.flatnonzero(hollow)
    if porta is None:
        at = int(inside[_nearest(points[inside], points[inside].mean(axis=0))])
    else:
        at = _nearest(points, porta)
    out = samples.way_out[hollow].sum(axis=0)
    up = -out / max(float(np.linalg.norm(out)), 1e-12)
    leaves = _highest_groove(samples, volume_mm3, points[at], up) if cava is None else cava
    veins = _nearest(points, leaves)
    return LiverPlaces(points[at], samples.inward[at], points[veins], samples.inward[veins], up)


def _highest_groove(
    samples: SurfaceSamples, volume_mm3: float, porta: FloatArray, up: FloatArray
) -> FloatArray:
    """Middle (3,) of the highest part of the grooves, the porta's left out."""
    size = float(np.cbrt(volume_mm3))
    away = np.linalg.norm(samples.points - porta, axis=1)
    groove = samples.openness <= min(_CONVEX, float(np.quantile(samples.openness, _GROOVES)))
    groove &= (away > _NEAREST * size) & (away < _FARTHEST * size)
    members = np.flatnonzero(groove)
    if not len(members):
        raise TissueError(
            "no groove of the vena cava is found; give the place where the hepatic veins leave "
            "(anatomy: {inlets: {vena_cava: {at_mm: [x, y, z]}}})"
        )
    height = (samples.points[members] - porta) @ up
    top = members[np.argsort(-height, kind="stable")[: max(1, int(_TOP * len(members)))]]
    middle: FloatArray = samples.points[top].mean(axis=0)
    return middle


def _nearest(points: FloatArray, place: FloatArray) -> int:
    return int(np.argmin(np.linalg.norm(points - place, axis=1)))
