"""Compute each pixel's openness (ambient occlusion, 0 to 1) from a depth buffer."""

from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import Any

import numpy as np
from numba import prange

from kernels import pjit

SAMPLES = 28
_GOLDEN = pi * (3.0 - sqrt(5.0))
_BIAS = 0.06


@pjit
def occlude(depth: Any, normal: Any, reach: float) -> Any:
    """Openness of each pixel's surroundings, from 1 (open) to 0 (enclosed).

    Samples on a golden spiral of radius ``reach`` count by how far they rise above the pixel's
    tangent plane, v·n / |v|, and less the farther they are (after McGuire et al. 2011, "The
    Alchemy screen-space ambient obscurance algorithm", doi 10.1145/2018323.2018327). Nothing that
    the depth buffer hides is known to it.

    Parameters
    ----------
    depth : (height, width) float64
        In pixels, towards the eye; -inf where there is nothing.
    normal : (height, width, 3) float64
        Of the surface: x to the right, y downwards, z towards the eye.
    reach : float
        In pixels.
    """
    height, width = depth.shape
    open_share = np.ones((height, width))
    for y in prange(height):
        for x in range(width):
            z = depth[y, x]
            if z == -np.inf:
                continue
            # A turn of its own for each pixel (Jimenez 2014) trades bands for fine grain.
            turn = 52.9829189 * ((0.06711056 * x + 0.00583715 * y) % 1.0) % 1.0 * 2.0 * pi
            hidden = 0.0
            for k in range(SAMPLES):
                r = reach * sqrt((k + 0.5) / SAMPLES)
                j = x + round(r * cos(k * _GOLDEN + turn))
                i = y + round(r * sin(k * _GOLDEN + turn))
                if i < 0 or j < 0 or i >= height or j >= width or depth[i, j] == -np.inf:
                    continue
                vx, vy, vz = float(j - x), float(i - y), depth[i, j] - z
                far = sqrt(vx * vx + vy * vy + vz * vz)
                if far == 0.0:
                    continue
                rises = (
                    vx * normal[y, x, 0] + vy * normal[y, x, 1] + vz * normal[y, x, 2]
                ) / far - _BIAS
                if rises > 0.0:
                    hidden += rises / (1.0 + (far / reach) ** 2)
            open_share[y, x] = max(0.0, 1.0 - 2.6 * hidden / SAMPLES)
    return open_share
