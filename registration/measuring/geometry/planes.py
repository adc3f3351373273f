"""Find the large plane faces of a design, and name them by direction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kernels.arrays import FloatArray, IntArray
from registration.alignment.distance import ModelSurface

LEAST_SHARE = 0.01
"""Of the design's surface, below which a plane is no face."""
CURVED = "curved outer face"
Plane = tuple[FloatArray, FloatArray, float]
"""Unit normal, a point, mm, and the root of the area, mm."""


def large_planes(surface: ModelSurface) -> tuple[IntArray, list[Plane]]:
    """Number of the large plane that each triangle lies in, -1 for none; the planes."""
    a, b, c = (surface.triangles[:, k] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    normal, middle = surface.normals[:, 0], (a + b + c) / 3
    offset = (normal * middle).sum(axis=1)
    key = np.round(np.column_stack([500 * normal, 200 * offset])).astype(np.int64)
    _, group = np.unique(key, axis=0, return_inverse=True)
    group = group.reshape(-1)
    total = np.bincount(group, area)
    label = np.full(len(area), -1, dtype=np.int64)
    planes: list[Plane] = []
    for g in np.argsort(-total, kind="stable"):
        if total[g] < LEAST_SHARE * area.sum():
            break
        first = int(np.flatnonzero(group == g)[0])
        if label[first] >= 0:
            continue
        # Rounding may have parted a plane: all that lies in it is gathered.
        own = (normal @ normal[first] > 0.9999) & (np.abs(offset - offset[first]) < 0.005)
        point = np.average(middle[own], axis=0, weights=area[own])
        planes.append((normal[first], point, float(np.sqrt(area[own].sum()))))
        label[own] = len(planes) - 1
    return label, planes


def plane_name(plane: Plane | None, planes: Sequence[Plane]) -> str:
    """Say how a face looks; of several that look the same way also where it lies."""
    if plane is None:
        return CURVED
    normal, point, _ = plane
    axis = int(np.abs(normal).argmax())
    if abs(normal[axis]) < np.cos(np.deg2rad(1.0)):
        way = ", ".join(f"{v:.2f}".replace("-", "\N{MINUS SIGN}") for v in normal + 0.0)
        name = f"face ({way})"
    else:
        name = f"face {'+' if normal[axis] > 0 else chr(0x2212)}{'xyz'[axis]}"
    alike = [one for one in planes if one[0] @ normal > 0.9999]
    return name if len(alike) == 1 else f"{name} at {point @ normal:.2f} mm"
