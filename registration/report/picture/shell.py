"""Compute the light that a translucent surface over the vessels lets through at each pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import prange

from kernels import jit, pjit
from registration.report.picture.tubes import BANDS

FACE_ON = 0.045
"""Opacity of a layer seen face-on."""

GRAZING = 0.42
"""Opacity that a layer seen edge-on has above that."""


@jit
def layer_opacity(facing: float) -> float:
    """Opacity of a layer whose normal has the share ``facing`` (0 to 1) along the view."""
    slant = 1.0 - facing
    return FACE_ON + GRAZING * slant * slant * slant


@pjit
def draw_shell(points: Any, normals: Any, faces: Any, depth: Any) -> Any:
    """Light let through by the layers in front of ``depth``, 1 where there are none.

    The product of all layers' transparencies, whose order doesn't matter as they share a colour.

    Parameters
    ----------
    points : (n, 3) float64
        In pixels, as in `registration.report.picture.tubes.draw_tubes`.
    normals : (m, 3, 3) float64
        Unit normal at each corner of each face.
    faces : (m, 3) int64
    depth : (height, width) float64
        Of what is opaque.

    Returns
    -------
    (height, width) float64
    """
    height, width = depth.shape
    through = np.ones((height, width))
    for band in prange(BANDS):
        top, bottom = band * height // BANDS, (band + 1) * height // BANDS
        for f in range(len(faces)):
            a, b, c = points[faces[f, 0]], points[faces[f, 1]], points[faces[f, 2]]
            y0 = max(top, int(np.ceil(min(a[1], b[1], c[1]))))
            y1 = min(bottom, int(np.floor(max(a[1], b[1], c[1]))) + 1)
            area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
            if y0 >= y1 or area == 0.0:
                continue
            x0 = max(0, int(np.ceil(min(a[0], b[0], c[0]))))
            x1 = min(width, int(np.floor(max(a[0], b[0], c[0]))) + 1)
            for y in range(y0, y1):
                for x in range(x0, x1):
                    v = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / area
                    w = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / area
                    u = 1.0 - v - w
                    if u < 0.0 or v < 0.0 or w < 0.0:
                        continue
                    if u * a[2] + v * b[2] + w * c[2] <= depth[y, x]:
                        continue
                    n = u * normals[f, 0] + v * normals[f, 1] + w * normals[f, 2]
                    length = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
                    facing = abs(n[2]) / length if length > 0.0 else 1.0
                    through[y, x] *= 1.0 - layer_opacity(facing)
    return through
