"""Sample a tissue's surface; compute the share of outward rays per point that meet no tissue."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi, sqrt
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from design.geometry.polyline import vectors_across
from design.tissue import Tissue, without_cavities
from design.vasculature.growth.root_search import surface_points
from kernels.arrays import BoolArray, FloatArray


class _Rays(NamedTuple):
    """How openness is measured."""

    number: int = 40  # from each place, spread over the half space as the cosine to the normal
    outer: float = 0.5  # openness above which a place belongs to no cavity, cleft or sinus
    steps: int = 80  # along a ray
    neighbours: int = 12  # over which openness is evened
    same_side: float = 0.3  # cosine between the normals of neighbours on the same side


RAYS = _Rays()
_GOLDEN = (1.0 + sqrt(5.0)) / 2.0


@dataclass(frozen=True)
class SurfaceSamples:
    """Places spread over a tissue's surface by area."""

    points: FloatArray  # (n, 3), mm
    inward: FloatArray  # (n, 3), unit normals into the tissue
    # (n,), 0 to 1: share of the rays into the outside that never meet the tissue again; the mean of
    # a place and its neighbours on the same side.
    openness: FloatArray
    way_out: FloatArray  # (n, 3), sum of the rays that leave, over all rays

    @property
    def outer(self) -> BoolArray:
        """Which places belong to the outer surface."""
        return self.openness > RAYS.outer


def sample_surface(
    tissue: Tissue, count: int, seed: int = 1, cavities: bool = True
) -> SurfaceSamples:
    """Spread places over the surface and find how open each is.

    The result depends on the shape alone, not on how its surface is cut into triangles.

    Parameters
    ----------
    cavities : bool
        Whether walls of closed cavities (a cyst) get places, too.
    """
    if not cavities:
        tissue = replace(tissue, surface=without_cavities(tissue.surface))
    points, inward = surface_points(tissue, count, np.random.default_rng([seed, 0xA7]))
    leaves, rays = _rays_that_leave(tissue, points, inward)
    way_out: FloatArray = np.einsum("nr,nrx->nx", leaves, rays) / RAYS.number
    return SurfaceSamples(points, inward, _even(points, inward, leaves.mean(axis=1)), way_out)


def _rays_that_leave(
    tissue: Tissue, points: FloatArray, inward: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return 1 for each ray (n, r) that leaves, else 0; and the rays (n, r, 3), unit vectors.

    Steps as long as the distance from the surface (sphere tracing, Hart 1996,
    doi 10.1007/s003710050084).
    """
    local = _hemisphere(RAYS.number)
    one, two = vectors_across(inward)
    rays = -local[:, 0, None] * one[:, None] - local[:, 1, None] * two[:, None]
    rays = rays - local[:, 2, None] * inward[:, None]
    low, high = tissue.bounds
    middle, reach = 0.5 * (low + high), 0.51 * float(np.linalg.norm(high - low))
    least = 0.5 * tissue.grid.spacing_mm
    at = (points - 4.0 * least * inward)[:, None] + np.zeros_like(rays)
    at, way = at.reshape(-1, 3), rays.reshape(-1, 3)
    leaves = np.zeros(len(at))
    going = np.arange(len(at))
    for _ in range(RAYS.steps):
        away = tissue.grid.distance(at[going])
        beyond = np.linalg.norm(at[going] - middle, axis=1) > reach
        leaves[going[beyond]] = 1.0
        on = (away > 0.0) & ~beyond
        going = going[on]
        at[going] += np.maximum(away[on], least)[:, None] * way[going]
    return leaves.reshape(len(points), RAYS.number), rays


def _hemisphere(count: int) -> FloatArray:
    """Return unit vectors (count, 3) about z, denser by their cosine to it."""
    n = np.arange(count) + 0.5
    radius, angle = np.sqrt(n / count), 2.0 * pi * n / _GOLDEN
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - n / count)])


def _even(points: FloatArray, inward: FloatArray, values: FloatArray) -> FloatArray:
    """Return the mean of each value and its neighbours' that face the same way."""
    near = cKDTree(points).query(points, RAYS.neighbours)[1]
    same = np.einsum("nkx,nx->nk", inward[near], inward) > RAYS.same_side
    mean: FloatArray = (values[near] * same).sum(axis=1) / same.sum(axis=1)
    return mean


def way_through(tissue: Tissue, points: FloatArray, way: FloatArray) -> FloatArray:
    """Return how far (n,) lines from points (n, 3) run along ``way`` (n, 3) in the tissue, mm."""
    least = 0.25 * tissue.grid.spacing_mm
    low, high = tissue.bounds
    far = float(np.linalg.norm(high - low))
    gone = np.full(len(points), 4.0 * least)
    going = np.arange(len(points))
    while len(going):
        room = -tissue.grid.distance(points[going] + gone[going, None] * way[going])
        on = (room > 0.0) & (gone[going] < far)
        gone[going[on]] += np.maximum(room[on], least)
        going = going[on]
    return gone
