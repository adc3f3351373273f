"""List groups of walls that face one way and lie off the design by over 75 µm after the fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray
from registration.alignment.distance import ModelSurface
from registration.alignment.fit import Fit, evenness, facing
from registration.alignment.motion import AXES

OFF_MM = 0.075
"""A side whose median is off by more contradicts the pose: faces of 3 mm of depth of which one is
0.16 mm off pull a pose 0.1 mm away before a lumen's walls show it by this much."""
RAGGED = 0.1
"""A side that weighs less than this (`evenness`) says nothing of the pose."""
LEAST_SHARE = 0.02
"""A side counts from this share of the points on."""


@dataclass(frozen=True)
class Misfit:
    """Walls that face one way and are off.

    Attributes
    ----------
    words : str
        "the outside facing low z", "walls of lumens facing high x".
    off_mm : float, mm
        Median signed distance, positive outside the solid.
    """

    words: str
    off_mm: float


def misfits(
    surface: ModelSurface, points: FloatArray, fit: Fit, blur_mm: float
) -> tuple[Misfit, ...]:
    """Return the sides that are off by more than `OFF_MM`, the worst first."""
    near = surface.query(fit.apply(points))
    residual = near.distance - surface.blurred(near.face, blur_mm) - fit.offset_mm
    side = facing(near.direction, surface.curvature[near.face])
    even = evenness(residual, side)
    out = []
    for number in range(12):
        here = side == number
        if here.mean() < LEAST_SHARE or even[here][0] < RAGGED:
            continue
        off = float(np.median(residual[here]))
        if abs(off) > OFF_MM:
            what = "curved walls" if number % 2 else "flat faces"
            end = "high" if number // 2 % 2 else "low"
            out.append(Misfit(f"{what} that face {end} {AXES[number // 4]}", off))
    return tuple(sorted(out, key=lambda m: -abs(m.off_mm)))
