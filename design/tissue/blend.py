"""Blend local quadratic fits around a cloud's points into one signed field on a grid (compiled)."""

from __future__ import annotations

from math import ceil, floor, sqrt
from typing import Any

from kernels import jit

NEAR = 0.2
"""Of the reach: within it, where a place lies beside a point matters little."""


@jit
def blend(
    points: Any,
    frame: Any,
    height: Any,
    reach: Any,
    origin: Any,
    spacing: float,
    total: Any,
    weight: Any,
) -> None:
    """Add each point's local surface to the lattice nodes within its reach.

    The local function of a point is w - h(u, v) in its frame, h a quadratic; its weight is
    Wendland's (1 - r)^4 (4 r + 1) of the distance r over the reach, and the less the more the
    place lies beside the point rather than along its normal: beyond a sharp edge the faces that
    end there would otherwise go on as fins.

    Parameters
    ----------
    points : (n, 3) float64, mm
    frame : (n, 3, 3) float64
        Rows: two tangents and the outward normal.
    height : (n, 6) float64
        Coefficients of 1, u, v, u², uv, v² in h.
    reach : (n,) float64, mm
    origin : (3,) float64, mm
        Node (0, 0, 0).
    total, weight : (a, b, c) float64
        Sums of weighted values and of weights, added to.
    """
    for n in range(len(points)):
        far = reach[n]
        first, last = [0, 0, 0], [0, 0, 0]
        for axis in range(3):
            middle = (points[n, axis] - origin[axis]) / spacing
            first[axis] = max(0, ceil(middle - far / spacing))
            last[axis] = min(total.shape[axis] - 1, floor(middle + far / spacing))
        f, c = frame[n], height[n]
        for i in range(first[0], last[0] + 1):
            x = origin[0] + i * spacing - points[n, 0]
            for j in range(first[1], last[1] + 1):
                y = origin[1] + j * spacing - points[n, 1]
                for k in range(first[2], last[2] + 1):
                    z = origin[2] + k * spacing - points[n, 2]
                    r = sqrt(x * x + y * y + z * z) / far
                    if r >= 1.0:
                        continue
                    u = f[0, 0] * x + f[0, 1] * y + f[0, 2] * z
                    v = f[1, 0] * x + f[1, 1] * y + f[1, 2] * z
                    w = f[2, 0] * x + f[2, 1] * y + f[2, 2] * z
                    h = c[0] + c[1] * u + c[2] * v + c[3] * u * u + c[4] * u * v + c[5] * v * v
                    near = (NEAR * far) ** 2
                    phi = (1.0 - r) ** 4 * (4.0 * r + 1.0)
                    phi *= (w * w + near) / (r * r * far * far + near)
                    total[i, j, k] += phi * (w - h)
                    weight[i, j, k] += phi
