"""Evenness of terminals over the tissue, so that volumes are compared at equal coverage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.checkers.containment import surface_tree, to_surface, winding_numbers
from benchmarks.checkers.read_network import Pieces
from benchmarks.checkers.read_stl import enclosed_volume

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Coverage:
    """Where the terminals end.

    Attributes
    ----------
    mean_mm, p95_mm : float
        Distance from a random point of the tissue to the nearest terminal's end. For N terminals
        scattered at random the mean is near 0.554 (V / N)^(1/3) (Hertz 1909).
    near_surface : float
        Terminals per volume within a quarter of (V / N)^(1/3) of the surface, over those in the
        whole tissue; 1 where they are scattered evenly.
    """

    mean_mm: float
    p95_mm: float
    near_surface: float


def coverage(net: Pieces, triangles: FloatArray, points: int = 20_000) -> Coverage:
    """Measure at ``points`` random points of the tissue (always the same ones)."""
    ends = net.end[np.isin(net.node[:, 1], net.outlets())]
    inside = points_in(triangles, points)
    distance, _ = cKDTree(ends).query(inside)
    depth = 0.25 * float(np.cbrt(enclosed_volume(triangles) / len(ends)))
    share = [_share_near(some, triangles, depth) for some in (ends, inside)]
    return Coverage(
        float(distance.mean()), float(np.quantile(distance, 0.95)), share[0] / max(share[1], 1e-9)
    )


def points_in(triangles: FloatArray, count: int) -> FloatArray:
    """Points scattered evenly in the tissue, (count, 3), mm."""
    random = np.random.default_rng(20_000)
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    found = np.empty((0, 3))
    while len(found) < count:
        tries = random.uniform(low, high, (2 * count, 3))
        found = np.concatenate([found, tries[winding_numbers(tries, triangles) > 0]])
    return found[:count]


def _share_near(points: FloatArray, triangles: FloatArray, depth: float) -> float:
    """Share of the points that lie nearer to the surface than ``depth``."""
    tree = surface_tree(triangles)
    within = np.full(len(points), depth)
    distance = to_surface(points, points, within, tree, triangles[tree.order])
    return float((distance < depth).mean())
