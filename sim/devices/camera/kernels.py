"""Kernel of the simulated camera: draw lines of ink into maps of thickness and of their crest."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kernels import jit
from kernels.arrays import FloatArray

SingleArray = NDArray[np.float32]


@jit
def draw_lines(
    segments: FloatArray,
    radius: FloatArray,
    crest: FloatArray,
    height: FloatArray,
    weight: FloatArray,
    profile: FloatArray,
    above_map: SingleArray,
    enough: float,
    thick_map: SingleArray,
    crest_map: SingleArray,
) -> None:
    """Draw capsules, each thickest in its middle; where they overlap the thickest counts.

    ``segments`` (n, 4) are x0, y0, x1, y1 and ``radius`` (n,) in pixels of the maps; ``crest``
    (n, 2) and ``height`` (n,) are mm: where a line's top is at its ends, and how thick it is.
    ``weight`` fades what lies deep. ``profile`` (m,) is a line's thickness over that in its middle,
    evenly over the square of the share of the radius. The outermost pixel counts by the share that
    is covered. Nothing is drawn where more than ``enough`` ink lies in ``above_map`` already.
    """
    ny, nx = thick_map.shape
    for s in range(len(radius)):
        x0, y0, x1, y1 = segments[s]
        r = radius[s]
        reach = r + 1.0
        dx, dy = x1 - x0, y1 - y0
        squared = dx * dx + dy * dy
        per_squared = 1.0 / squared if squared > 0.0 else 0.0
        per_radius = (len(profile) - 1) / (r * r)
        thickest = weight[s] * height[s]
        outer, inner = (r + 0.5) ** 2, max(r - 0.5, 0.0) ** 2
        first = max(0, math.ceil(min(y0, y1) - reach))
        last = min(ny - 1, math.floor(max(y0, y1) + reach))
        for row in range(first, last + 1):
            t0, t1 = 0.0, 1.0
            if abs(dy) > 1e-9:
                ta, tb = (row - reach - y0) / dy, (row + reach - y0) / dy
                t0, t1 = max(0.0, min(ta, tb)), min(1.0, max(ta, tb))
            xa, xb = x0 + t0 * dx, x0 + t1 * dx
            left = max(0, math.ceil(min(xa, xb) - reach))
            right = min(nx - 1, math.floor(max(xa, xb) + reach))
            py = row - y0
            for col in range(left, right + 1):
                if above_map[row, col] > enough:
                    continue
                px = col - x0
                t = min(1.0, max(0.0, (px * dx + py * dy) * per_squared))
                ox, oy = px - t * dx, py - t * dy
                square = ox * ox + oy * oy
                if square >= outer:
                    continue
                cover = 1.0
                if square > inner:
                    cover = r - math.sqrt(square) + 0.5
                share = profile[min(int(square * per_radius), len(profile) - 1)] * cover
                thick = np.float32(thickest * share)
                if thick > thick_map[row, col]:
                    thick_map[row, col] = thick
                upper = crest[s, 0] + t * (crest[s, 1] - crest[s, 0])
                top = np.float32(upper - height[s] * (1.0 - share))
                if top > crest_map[row, col]:
                    crest_map[row, col] = top
