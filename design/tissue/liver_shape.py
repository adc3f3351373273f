"""Make a parametric liver surface: a wedge hollow below, with the vena cava's groove."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from design.errors import TissueError
from design.geometry.surface import Surface
from design.tissue.manifolds import arrays_of

DEPTH, HEIGHT = 0.65, 0.62
"""Of the right lobe, over the width."""

TAPER = 0.55
"""Share of depth and height that is lost from the right side to the left."""

HOLLOW, HOLLOW_SPREAD = 0.2, 0.12
"""Depth of the hollow of the porta over the width; standard deviation of its outline."""

GROOVE, GROOVE_SPREAD = 0.18, 0.06
"""Depth of the vena cava's groove over the width; standard deviation across it."""


def liver(width_mm: float = 60.0, sides: int = 96) -> Surface:
    """Wedge along x, thick at -x, its hollow below, the groove at -y, lying on z = 0.

    An ellipsoid, tapered, with a Gaussian dent from below and a groove from behind.

    Raises
    ------
    TissueError
        When the width isn't positive.
    """
    if not width_mm > 0:
        raise TissueError(f"liver: width_mm is {width_mm:g}; give a width above 0")
    ball, faces = arrays_of(Manifold.sphere(1.0, sides))
    x, y, z = 0.5 * ball.T
    dent = HOLLOW * np.clip(-2.0 * z, 0.0, None) ** 2
    dent *= np.exp(-0.5 * (x**2 + y**2) / HOLLOW_SPREAD**2)
    groove = GROOVE * np.clip(-2.0 * y, 0.0, None) ** 2 * np.exp(-0.5 * (x / GROOVE_SPREAD) ** 2)
    thick = 1.0 - TAPER * (x + 0.5)
    y, z = thick * (DEPTH * y + groove), thick * (HEIGHT * z + dent)
    points = width_mm * np.column_stack([x, y, z - z.min()])
    return Surface(np.ascontiguousarray(points), faces)
