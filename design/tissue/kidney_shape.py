"""Make a parametric kidney surface: a bean with a sinus at its hilum."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from design.errors import TissueError
from design.geometry.surface import Surface
from design.tissue.manifolds import arrays_of

WIDTH, THICKNESS = 0.5, 0.42
"""Of the bean, over its length."""

BEND = 0.06
"""How far the poles lean to the hilum's side, over the length."""

SINUS_DEPTH, SINUS_HEIGHT, SINUS_THICKNESS = 0.24, 0.15, 0.1
"""Of the sinus, over the length; the latter two are standard deviations of its Gaussian outline."""


def kidney(length_mm: float = 60.0, sides: int = 96) -> Surface:
    """Bean along y with its hilum at the -x side, lying on z = 0.

    An ellipsoid, bent, with a Gaussian dent in the middle of its concave side.

    Raises
    ------
    TissueError
        When the length isn't positive.
    """
    if not length_mm > 0:
        raise TissueError(f"kidney: length_mm is {length_mm:g}; give a length above 0")
    ball, faces = arrays_of(Manifold.sphere(1.0, sides))
    x, y, z = 0.5 * ball.T
    z = THICKNESS * z
    dent = np.clip(-2.0 * x, 0.0, None) ** 2
    dent *= np.exp(-0.5 * ((y / SINUS_HEIGHT) ** 2 + (z / SINUS_THICKNESS) ** 2))
    x = WIDTH * x + SINUS_DEPTH * dent - BEND * (2.0 * y) ** 2
    points = length_mm * np.column_stack([x, y, z - z.min()])
    return Surface(np.ascontiguousarray(points), faces)
