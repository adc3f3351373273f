"""Render rounded tubes along parallel rays by exact intersection, with a depth buffer.

A piece is the hull of the spheres between its ends, so neighbours that share an end and a radius
join without a seam.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
from numba import prange

from kernels import jit, pjit

BANDS = 32
"""Strips of the picture, each drawn by one thread."""


@jit
def front_of_sphere(wx: float, wy: float, r: float) -> float:
    """Height of a sphere's front above its centre at (wx, wy) from it; -inf beside it."""
    left = r * r - wx * wx - wy * wy
    return sqrt(left) if left >= 0.0 else -np.inf


@jit
def front_of_cone(
    wx: float, wy: float, ux: float, uy: float, uz: float, ra: float, dr: float
) -> tuple[float, float]:
    """Height above the first end, and place along the piece, of the hull's front; -inf beside it.

    With w from the first end, u along the piece and radius ra + t dr the hull's surface is where
    f(t) = |w - t u|² - (ra + t dr)² and f'(t) vanish. With k = u² - dr² that is
    t = (w·u + ra dr) / k and k (w² - ra²) = (w·u + ra dr)², a quadratic in w's height.
    """
    k = ux * ux + uy * uy + uz * uz - dr * dr
    if k <= 0.0:
        # One end sphere lies within the other and is all there is.
        return -np.inf, 0.0
    a = k - uz * uz
    m = wx * ux + wy * uy + ra * dr
    c = k * (wx * wx + wy * wy - ra * ra) - m * m
    b = m * uz
    root = b * b - a * c
    if root < 0.0:
        return -np.inf, 0.0
    # The second root as c over the first stays exact as a goes through 0, where a cone that
    # points at the eye has its tip just above its base's rim.
    both = b + sqrt(root) if b >= 0.0 else b - sqrt(root)
    best, place = -np.inf, 0.0
    for which in range(2):
        over, under = (both, a) if which == 0 else (c, both)
        if under == 0.0:
            continue
        height = over / under
        t = (m + height * uz) / k
        if 0.0 <= t <= 1.0 and height > best:
            best, place = height, t
    return best, place


@jit
def front_of_piece(
    px: float, py: float, a: Any, b: Any, ra: float, rb: float
) -> tuple[float, float]:
    """Depth of a piece's front at pixel (px, py), and the place t along it; -inf beside it."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    depth, t = front_of_cone(px - a[0], py - a[1], ux, uy, uz, ra, rb - ra)
    depth += a[2]
    near = a[2] + front_of_sphere(px - a[0], py - a[1], ra)
    if near > depth:
        depth, t = near, 0.0
    far = b[2] + front_of_sphere(px - b[0], py - b[1], rb)
    if far > depth:
        depth, t = far, 1.0
    return depth, t


@pjit
def draw_tubes(
    start: Any, end: Any, start_radius: Any, end_radius: Any, height: int, width: int
) -> Any:
    """Depth buffer of all pieces.

    Parameters
    ----------
    start, end : (n, 3) float64
        In pixels: x to the right, y downwards, z towards the eye; the centre of pixel (i, j) is
        at x = j, y = i.
    start_radius, end_radius : (n,) float64
        In pixels.

    Returns
    -------
    depth : (height, width) float64
        z of the nearest surface; -inf where there is none.
    piece : (height, width) int64
        Whose it is; -1 where there is none.
    place : (height, width) float64
        Where along it, 0 to 1.
    """
    depth = np.full((height, width), -np.inf)
    piece = np.full((height, width), -1)
    place = np.zeros((height, width))
    for band in prange(BANDS):
        top, bottom = band * height // BANDS, (band + 1) * height // BANDS
        for i in range(len(start)):
            ra, rb = start_radius[i], end_radius[i]
            y0 = max(top, int(np.ceil(min(start[i, 1] - ra, end[i, 1] - rb))))
            y1 = min(bottom, int(np.floor(max(start[i, 1] + ra, end[i, 1] + rb))) + 1)
            if y0 >= y1:
                continue
            x0 = max(0, int(np.ceil(min(start[i, 0] - ra, end[i, 0] - rb))))
            x1 = min(width, int(np.floor(max(start[i, 0] + ra, end[i, 0] + rb))) + 1)
            for y in range(y0, y1):
                for x in range(x0, x1):
                    z, t = front_of_piece(float(x), float(y), start[i], end[i], ra, rb)
                    if z > depth[y, x]:
                        depth[y, x] = z
                        piece[y, x] = i
                        place[y, x] = t
    return depth, piece, place
