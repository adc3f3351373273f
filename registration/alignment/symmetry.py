"""Vessels and freedoms under motions that map a design onto itself."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from design.geometry.polyline import arc_lengths, places_along
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.alignment.distance import ModelSurface
from registration.alignment.rivals import SAME_MM, spread_points

SAMPLES = 9
"""Points of a vessel's axis by which its image is found."""
TURNS = (1.0, 0.61)
"""Angles, rad, after which a body of revolution is still the same; no part of a full turn."""


def moved_vessels(network: VesselNetwork, motion: FloatArray) -> tuple[int, ...]:
    """Return for each vessel the one that it comes to lie on; empty where the network doesn't.

    Parameters
    ----------
    network : VesselNetwork
    motion : (4, 4) float64
        In the part's frame, mm.
    """
    start, end, first, last, owner = network.pieces()
    way, radius = end - start, (first + last) / 2
    square = np.maximum(np.einsum("pk,pk->p", way, way), 1e-18)
    out = []
    for points, _ in network.polylines():
        path = arc_lengths(points)
        share = (np.arange(SAMPLES) + 0.5) / SAMPLES
        axis = places_along(points, path, share * path[-1]) @ motion[:3, :3].T + motion[:3, 3]
        off = axis[:, None] - start
        along = np.clip(np.einsum("spk,pk->sp", off, way) / square, 0.0, 1.0)
        away = np.linalg.norm(off - along[..., None] * way, axis=2)
        nearest = away.argmin(axis=1)
        if (away.min(axis=1) > radius[nearest] / 2).any():
            return ()
        out.append(int(np.bincount(owner[nearest]).argmax()))
    return tuple(out) if len(set(out)) == len(out) else ()


def turns_into_itself(surface: ModelSurface, twist: FloatArray, middle: FloatArray) -> bool:
    """Return whether a design is the same after any turn along a free motion of its pose.

    Parameters
    ----------
    surface : ModelSurface
    twist : (6,) float64
        Rotation vector about `middle`, and shift, mm.
    middle : (3,) float64, mm
    """
    angle = float(np.linalg.norm(twist[:3]))
    span = float(np.linalg.norm(np.ptp(surface.bounds, axis=0)))
    if angle * span < np.linalg.norm(twist[3:]):
        return False  # a shift: no bounded part is the same after one
    x, y, z = twist[:3] / angle
    rate = np.zeros((4, 4))
    rate[:3, :3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    rate[:3, 3] = twist[3:] / angle
    points = spread_points(surface) - middle
    for turn in TURNS:
        motion = expm(turn * rate)
        moved = points @ motion[:3, :3].T + motion[:3, 3] + middle
        if np.abs(surface.query(moved).distance).max() > SAME_MM:
            return False
    return True
