"""Lay trunks and branches of a heart's left and right coronary artery below the epicardium."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from design.anatomy.graph_trunk import LayerForest, apart_for, cheapest_path, spread_sites
from design.anatomy.heart_places import HeartPlaces
from design.anatomy.layer import Layer, below_surface, join_layer
from design.anatomy.main_branches import MainBranch
from design.anatomy.openness import SurfaceSamples
from design.anatomy.trunk_lines import outward
from design.errors import GrowthError, TissueError
from design.tissue import Tissue
from kernels.arrays import FloatArray, IntArray

LEFT, RIGHT = 0, 1
"""Numbers of the two coronaries' trees."""

_BELOW_RING = 0.07
"""Of the epicardium's height: how far the atrioventricular groove lies below its rim."""

_LEFT_OF_GROOVE, _RIGHT_OF_GROOVE = np.radians(18.0), np.radians(38.0)
_CIRCUMFLEX_ENDS = np.radians(35.0)
"""Before the posterior groove, which the right coronary reaches (right dominance)."""

_POSTERIOR_ENDS = 0.72
"""Part of the way from base to apex that the posterior interventricular branch goes."""

_COARSE = (8.0, 4.0, 2.0, 1.0)
"""Distances of side branches, over the last: the longest branches come first, so that a main branch
parts into some nearly as wide, not into many narrow ones along one long way."""

_WAYPOINT = np.radians(30.0)

_DEEP = 0.95
"""Of a depth, what a place must have."""

_GUIDE = 1.0
"""Depth at which trunks are planned, mm, where walls allow it."""
_SHALLOWER = 0.8
_COVERED, _LEAST_COVERED = 0.8, 0.5
"""Of the epicardium, what must be so deep; and at the least depth."""
_ACROSS = 41
"""Places across a wall by which its thickness is told."""

_NARROW = 6.0
"""Cost of a main branch's way where the wall has no room for it, over that elsewhere."""


@dataclass(frozen=True)
class _Epicardium:
    """A layer below the epicardium, with each place's height and angle."""

    layer: Layer
    height: FloatArray
    angle: FloatArray
    ring: FloatArray
    extent: float
    radius: FloatArray
    cost: FloatArray

    def at_ring(self, angle: float) -> int:
        """The place in the atrioventricular groove at an angle."""
        off = np.abs(wrapped(self.angle - angle)) * np.maximum(self.radius, 1e-9)
        away = off + 2.0 * np.abs(self.height - self.ring)
        return int(np.argmin(away + (self.cost - 1.0) * 0.05 * self.extent))

    def along_ring(self, begin: float, end: float) -> IntArray:
        """Places from one angle to another through the groove, the way the angles go."""
        weight = self.cost * (1.0 + 25.0 * np.abs(self.height - self.ring) / self.extent)
        steps = max(1, round(abs(end - begin) / _WAYPOINT))
        stops = [self.at_ring(angle) for angle in np.linspace(begin, end, steps + 1)]
        return joined_paths(self.layer, weight, stops)

    def along_groove(self, start: int, angle: float, end: int) -> IntArray:
        """Places from ``start`` down a groove to ``end``."""
        off = np.abs(wrapped(self.angle - angle)) * self.radius
        weight = self.cost * (1.0 + 25.0 * off / self.extent)
        return cheapest_path(self.layer, weight, start, end)


def wrapped(angle: FloatArray) -> FloatArray:
    """Angles between -π and π."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def joined_paths(layer: Layer, weight: FloatArray, stops: list[int]) -> IntArray:
    """The cheapest path through stops in turn, no place twice."""
    path = [stops[0]]
    for begin, end in pairwise(stops):
        for place in cheapest_path(layer, weight, begin, end)[1:].tolist():
            if place in path:
                del path[path.index(place) + 1 :]
            else:
                path.append(place)
    return np.array(path, dtype=np.int64)


def guide_depth(
    tissue: Tissue, samples: SurfaceSamples, places: HeartPlaces, least_mm: float
) -> float:
    """Depth below the epicardium at which trunks are planned, mm: less where walls are thin.

    Raises
    ------
    TissueError
        Where most of the wall has no room at ``least_mm`` either.
    """
    points, inward = samples.points[places.epicardium], samples.inward[places.epicardium]
    depth = max(_GUIDE, least_mm)
    while True:
        deep = below_surface(tissue, points, inward, depth)[1]
        if deep.mean() >= _COVERED or (depth <= least_mm and deep.mean() >= _LEAST_COVERED):
            return depth
        if depth <= least_mm:
            raise _too_thin(tissue, points[~deep], inward[~deep], least_mm, float(deep.mean()))
        depth = max(_SHALLOWER * depth, least_mm)


def _too_thin(
    tissue: Tissue, points: FloatArray, inward: FloatArray, depth_mm: float, covered: float
) -> TissueError:
    """What is said of walls below whose ``points`` (n, 3) no trunk fits at a depth."""
    across = np.linspace(0.0, 2.0 * depth_mm, _ACROSS)[1:]
    along = points[:, None] + across[:, None] * inward[:, None]
    out = tissue.grid.distance(along.reshape(-1, 3)).reshape(len(points), -1) >= 0.0
    thick = np.where(out.any(axis=1), across[out.argmax(axis=1)], across[-1])
    middle = int(np.argsort(thick)[len(thick) // 2])
    x, y, z = points[middle]
    return TissueError(
        f"the heart's walls are too thin for coronaries: near ({x:.4g}, {y:.4g}, {z:.4g}) mm "
        f"{thick[middle]:.2g} mm thick, and below {1.0 - covered:.0%} of the epicardium thinner "
        f"than the {2.0 * depth_mm:.2g} mm that a trunk_depth_mm of {depth_mm:g} needs; give a "
        f"trunk_depth_mm of {0.4 * float(np.percentile(thick, 20)):.2g}, or a mesh of thicker walls"
    )


def heart_layer(
    tissue: Tissue, samples: SurfaceSamples, places: HeartPlaces, depth_mm: float
) -> Layer:
    """Places ``depth_mm`` below the epicardium."""
    mine = places.epicardium
    points, deep = below_surface(tissue, samples.points[mine], samples.inward[mine], depth_mm)
    return join_layer(tissue, points[deep], 0.5 * depth_mm)


def narrow_places(tissue: Tissue, layer: Layer, depth_mm: float) -> NDArray[np.bool_]:
    """Places (n,) of the layer below which the tissue isn't so deep."""
    deeper = depth_mm + tissue.grid.distance(layer.points)
    below = layer.points - deeper[:, None] * outward(tissue, layer.points)
    return np.asarray(-tissue.grid.distance(below) < _DEEP * depth_mm)


def heart_forest(
    layer: Layer,
    places: HeartPlaces,
    ends: int,
    balance: float,
    ostia: dict[int, FloatArray] | None = None,
    narrow: NDArray[np.bool_] | None = None,
) -> tuple[LayerForest, tuple[MainBranch, ...]]:
    """Left and right coronary over the epicardium, with so many ends together; main branches.

    Left: down the anterior interventricular groove round the apex, and to the left through the
    atrioventricular groove. Right: through it to the crux, then down the posterior groove.

    Parameters
    ----------
    ostia : of LEFT and RIGHT, (3,) float64, mm, optional
        Where the coronaries begin, in place of the found ones.
    narrow : (n,) bool, optional
        Places of the layer that main branches go round, as far as that isn't much longer.
    """
    if ends < 6:
        raise GrowthError(f"{ends} trunk ends are too few for two coronaries; ask for 6 at least")
    epi = _epicardium(layer, places, narrow)
    front, back = places.grooves
    back += 2 * np.pi
    apart = apart_for(layer, ends)
    forest = LayerForest(layer, balance, layer.length.copy(), apart)
    apex = int(np.argmin(epi.height))
    begin = {LEFT: front + _LEFT_OF_GROOVE, RIGHT: front - _RIGHT_OF_GROOVE}
    for tree, place in (ostia or {}).items():
        begin[tree] = float(places.angle(place[None])[0])
    left = epi.along_ring(begin[LEFT], back - _CIRCUMFLEX_ENDS)
    right = epi.along_ring(begin[RIGHT], back - 2 * np.pi)
    for tree, path in ((LEFT, left), (RIGHT, right)):
        forest.plant(tree, int(path[0]))
    down = epi.along_groove(int(left[0]), front, apex)
    for path in (down, left, right):
        _extend_free(forest, path)
    # A right coronary that meets the left one ends there.
    crux = int(right[forest.tree[right] == RIGHT][-1])
    lowest = epi.height[crux] + _POSTERIOR_ENDS * (epi.height[apex] - epi.height[crux])
    off = np.abs(wrapped(epi.angle - back)) * epi.radius + np.abs(epi.height - lowest)
    posterior = epi.along_groove(crux, back, int(np.argmin(off)))
    _extend_free(forest, posterior)
    branches = (
        MainBranch("left anterior descending branch", LEFT, layer.points[down], True),
        MainBranch("left circumflex branch", LEFT, layer.points[left], True),
        MainBranch("right coronary's trunk", RIGHT, layer.points[right], True),
        MainBranch("posterior descending branch", RIGHT, layer.points[posterior]),
    )
    taken = layer.points[np.flatnonzero(forest.parent > -2)]
    sites = spread_sites(layer.points, 3 * ends, taken)
    for coarse in _COARSE:
        forest.apart = coarse * apart
        forest.join(sites)
    return forest, branches


def ostium_above(tissue: Tissue, place: FloatArray, up: FloatArray) -> FloatArray:
    """Where a line from a place of the layer towards the base leaves the tissue, (3,), mm.

    Where that is far, the nearest place of the surface.
    """
    step = 0.25 * tissue.grid.spacing_mm
    depth = -float(tissue.grid.distance(place[None])[0])
    for direction in (up, outward(tissue, place[None])[0]):
        along = place + step * np.arange(1, 1 + int(12.0 * depth / step))[:, None] * direction
        out = np.flatnonzero(tissue.grid.distance(along) >= 0.0)
        if len(out):
            ostium: FloatArray = along[out[0]]
            return ostium
    raise GrowthError("no way out to the surface was found at a coronary's begin; give its place")


def _extend_free(forest: LayerForest, path: IntArray) -> None:
    """Go along a path up to the first place that another tree or branch has taken."""
    taken = forest.parent[path] > -2
    free = np.flatnonzero(~taken)
    if not len(free):
        return
    first = int(free[0])
    later = np.flatnonzero(taken[first:])
    end = first + int(later[0]) if len(later) else len(path)
    forest.extend(path[max(first - 1, 0) : end])


def _epicardium(layer: Layer, places: HeartPlaces, narrow: NDArray[np.bool_] | None) -> _Epicardium:
    height, angle = places.height(layer.points), places.angle(layer.points)
    extent = float(np.ptp(height))
    rim = _rim(height, angle)
    along = layer.points - places.middle
    radius = np.linalg.norm(along - np.outer(along @ places.base, places.base), axis=1)
    cost = np.ones(len(height)) if narrow is None else np.where(narrow, _NARROW, 1.0)
    return _Epicardium(layer, height, angle, rim - _BELOW_RING * extent, extent, radius, cost)


def _rim(height: FloatArray, angle: FloatArray, sectors: int = 36) -> FloatArray:
    """Height of the epicardium's upper rim at each angle, evened over three sectors."""
    sector = np.floor((angle + np.pi) / (2 * np.pi) * sectors).astype(np.int64) % sectors
    top = np.full(sectors, np.nan)
    for n in range(sectors):
        mine = height[sector == n]
        if len(mine):
            top[n] = np.percentile(mine, 97)
    known = np.flatnonzero(np.isfinite(top))
    top = np.interp(np.arange(sectors), known, top[known], period=sectors)
    top = np.convolve(np.concatenate([top[-2:], top, top[:2]]), np.ones(5) / 5, "valid")
    at = (angle + np.pi) / (2 * np.pi) * sectors - 0.5
    rim: FloatArray = np.interp(at, np.arange(sectors), top, period=sectors)
    return rim
