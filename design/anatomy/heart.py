"""Grow a heart's left and right coronary artery on the epicardium, with branches into the wall."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.anatomy.from_trunks import DEPTH_MARGIN, TrunkPlan
from design.anatomy.grown import AnatomicTrees, Trees, grow_fitted, trunk_ends
from design.anatomy.heart_places import FEWEST, HeartPlaces, find_heart_places
from design.anatomy.main_branches import (
    LAID,
    MainBranch,
    line_pieces,
    lost_branch,
    missing_branches,
    trunk_pieces,
    trunks_mm,
    with_published_radii,
)
from design.anatomy.openness import SurfaceSamples, sample_surface
from design.anatomy.perforators import with_perforators
from design.anatomy.trunk_lines import (
    Layer,
    LayerForest,
    TrunkLines,
    apart_for,
    below_surface,
    cheapest_path,
    join_layer,
    lines_of,
    outward,
    spread_sites,
)
from design.errors import GrowthError, NoRoomError, TissueError
from design.network import VesselKind
from design.tissue import Tissue
from design.units import PA_PER_MMHG
from design.vasculature.growth.forest import likely_radius
from design.vasculature.growth.parts import check_inlet
from design.vasculature.growth.supply import check_one_part, demand_points
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree
from kernels.arrays import FloatArray, IntArray

Place = tuple[float, float, float]
_NARROWER: Final = 3
"""Times that the drop is raised at most, where trunks are too wide for the wall."""
_HIGHEST: Final = 7.0
"""Pressure drop that is chosen at most, over the given one; as in `published_match`."""
NAMES: Final = ("left_coronary", "right_coronary")
_SAMPLES = 12_000
_VOLUME = 20_000
_WIDEST: Final = 0.17
"""Radius over the root's at which branches of the epicardium's trunks take on no more terminals
while there are few: they may still widen to a fifth, where a trunk begins. Ours."""
_LEAST_FED: Final = 4
"""Terminals that such a branch may feed however few there are."""


@dataclass(frozen=True)
class HeartAnatomy:
    """What a heart's coronaries are told; what isn't is found in its shape.

    Attributes
    ----------
    base, right : (float, float, float), optional
        Directions from the apex to the base, and from the left ventricle to the right one.
    left_ostium_mm, right_ostium_mm : (float, float, float), optional
        Near where the coronaries begin.
    trunk_ends : int
        How many ends the epicardial vessels have, at about.
    trunk_depth_mm : float, mm
        Least depth of their axes.
    balance : float
        See `LayerForest`.
    published_radii : bool
        Change the pressure drop as little as brings all orders' diameters, lengths and ratios
        within the published spread (Kassab et al. 1993), as far as one drop can.
    """

    base: Place | None = None
    right: Place | None = None
    left_ostium_mm: Place | None = None
    right_ostium_mm: Place | None = None
    trunk_ends: int = 600
    trunk_depth_mm: float = 0.3
    balance: float = 0.5
    published_radii: bool = False


def grow_heart(
    tissue: Tissue, options: GrowthOptions, anatomy: HeartAnatomy | None = None
) -> AnatomicTrees:
    """Grow left and right coronary in any heart's ventricles.

    Base, right side and grooves are found in the shape (`find_heart_places`). The trunks run
    below the epicardium: left main, anterior descending and circumflex; right with its posterior
    descending; and side branches all over it. From these the tree goes on into the wall.

    Raises
    ------
    TissueError, GrowthError
        Where no layer, ostium or tree fits.
    """
    anatomy = anatomy or HeartAnatomy()
    free = anatomy.published_radii and options.smallest_radius_mm is None
    highest = _HIGHEST * options.pressure_drop_pa
    narrower, before = options, None
    for left in range(_NARROWER, -1, -1):
        try:
            made = _grow(tissue, narrower, anatomy)
            break
        except NoRoomError as error:
            drop = narrower.pressure_drop_pa * error.drop_factor
            if not (free and left and drop <= highest and error.nearer_than(before)):
                raised = narrower.pressure_drop_pa / options.pressure_drop_pa
                told = "" if narrower is options else f" ({_mmhg(narrower)} mmHg were tried last)"
                raise error.around(after=told).beyond(raised) from error
            narrower, before = replace(narrower, pressure_drop_pa=drop), error
    return replace(made, notes=(*made.notes, *_drop_note(made.trees[0], options, narrower)))


def _mmhg(options: GrowthOptions) -> str:
    return f"{options.pressure_drop_pa / PA_PER_MMHG:.3g}"


def _grow(tissue: Tissue, options: GrowthOptions, anatomy: HeartAnatomy) -> AnatomicTrees:
    """The coronaries with the options' pressure drop, or another nearer to published radii."""
    ends = trunk_ends(anatomy.trunk_ends, options.terminals, "heart")
    check_one_part(tissue)
    samples = sample_surface(tissue, _SAMPLES, options.seed)
    places = find_heart_places(samples, _vector(anatomy.base), _vector(anatomy.right))
    depth = guide_depth(tissue, samples, places, anatomy.trunk_depth_mm)
    layer = heart_layer(tissue, samples, places, depth)
    given = {LEFT: anatomy.left_ostium_mm, RIGHT: anatomy.right_ostium_mm}
    for tree, place in given.items():
        check_inlet(tissue, NAMES[tree], place)
    near = {tree: np.array(place) for tree, place in given.items() if place is not None}
    wide = DEPTH_MARGIN * likely_radius(tissue, options) + options.clearance_mm
    narrow = narrow_places(tissue, layer, wide)
    forest, branches = heart_forest(layer, places, ends, anatomy.balance, near, narrow)
    begins = {tree: _begin(forest, tree, given) for tree in given}
    ostia = {t: ostium_above(tissue, layer.points[i], places.base) for t, i in begins.items()}
    volume, _ = demand_points(tissue, _VOLUME, options.seed)
    plan = TrunkPlan(
        lines_of(forest, ostia, volume),
        anatomy.trunk_depth_mm,
        branches=lambda lines, radius: with_perforators(tissue, lines, radius, volume, options),
        branches_are_trunks=False,
        widest_branch=_widest_branch(options),
        main=frozenset(place.tobytes() for one in branches for place in one.line),
        lost=lambda lines, radius: lost_branch(branches, line_pieces(lines, radius)),
    )
    trees = grow_fitted(tissue, plan, options)
    lost = lost_branch(branches, trunk_pieces(trees))
    if lost is not None:
        raise lost
    if anatomy.published_radii:
        trees = with_published_radii(trees, tissue, plan, options, branches, volume)
    notes = (
        *_notes(samples, places, ostia),
        *_left_out_note(plan.lines, trees),
        *missing_branches(branches, trunk_pieces(trees)),
    )
    return AnatomicTrees(trees, (VesselKind.ARTERY,) * 2, NAMES, notes)


def _widest_branch(options: GrowthOptions) -> float:
    """See `_WIDEST`; by Murray's law, where each coronary has half of the terminals."""
    part = 2.0 * _LEAST_FED / options.terminals
    return float(max(_WIDEST, part ** (1.0 / options.murray_exponent)))


def _drop_note(
    tree: VesselTree, options: GrowthOptions, narrower: GrowthOptions
) -> tuple[str, ...]:
    """What is said of a pressure drop that was changed for thin walls or for published radii."""
    ours, before = tree.pressure_drop_pa, options.pressure_drop_pa
    if abs(ours / before - 1.0) < 1e-9:
        return ()
    why = "with it diameters and lengths are nearest to those of Kassab et al. 1993"
    if ours < before:
        why += "; where its wider trunks leave tissue without vessels, give a drop yourself"
    if ours >= narrower.pressure_drop_pa > before:
        why = "wider trunks don't fit in the wall"
    return (
        f"pressure_drop_mmhg was taken as {ours / PA_PER_MMHG:.3g} instead of "
        f"{before / PA_PER_MMHG:.3g}: {why}",
    )


def _left_out_note(lines: TrunkLines, trees: Trees) -> tuple[str, ...]:
    """What is said of trunks' branches that don't fit."""
    planned, laid = _planned_mm(lines), trunks_mm(trees)
    if laid > LAID * planned:
        return ()
    return (
        f"trunks are {laid:.0f} mm long, {planned:.0f} mm were planned: branches that didn't fit "
        "were left out; a higher pressure_drop_mmhg or fewer trunk_ends leave them room",
    )


def _planned_mm(lines: TrunkLines) -> float:
    ends = np.flatnonzero(lines.parent >= 0)
    pieces = lines.points[ends] - lines.points[lines.parent[ends]]
    return float(np.linalg.norm(pieces, axis=1).sum())


def _begin(forest: LayerForest, tree: int, given: dict[int, Place | None]) -> int:
    """Number of the place in the layer where a coronary begins."""
    places = np.flatnonzero((forest.parent == -1) & (forest.tree == tree))
    if len(places) == 0:
        given_text = ", ".join(
            f"{NAMES[one]} near {place}" for one, place in given.items() if place
        )
        raise GrowthError(
            f"{NAMES[tree]} finds no place of its own to begin (given: {given_text or 'none'}); "
            "give left_coronary and right_coronary places further apart"
        )
    return int(places[0])


def _vector(place: Place | None) -> np.ndarray[tuple[int], np.dtype[np.float64]] | None:
    return None if place is None else np.array(place, dtype=np.float64)


def _notes(
    samples: SurfaceSamples, places: HeartPlaces, ostia: dict[int, np.ndarray]
) -> tuple[str, ...]:
    say = "({:.3g}, {:.3g}, {:.3g})"
    hollow = (~samples.outer).mean() >= FEWEST
    guess = (
        "no cavity opens in this shape, so that it may not be a heart's: base and right side are "
        "guesses from its outline; give base_direction and right_direction",
    )
    return (
        *(() if hollow else guess),
        f"the heart's base was taken to lie towards {say.format(*places.base)}, its right side "
        f"towards {say.format(*places.right)}",
        *places.doubts,
        "ostia: "
        + ", ".join(f"{name} at {say.format(*ostia[tree])} mm" for tree, name in enumerate(NAMES)),
    )


# Lay trunks and branches of a heart's left and right coronary artery below the epicardium.

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
    ostia: dict[int, FloatArray],
    narrow: NDArray[np.bool_],
) -> tuple[LayerForest, tuple[MainBranch, ...]]:
    """Left and right coronary over the epicardium, with so many ends together; main branches.

    Left: down the anterior interventricular groove round the apex, and to the left through the
    atrioventricular groove. Right: through it to the crux, then down the posterior groove.

    Parameters
    ----------
    ostia : of LEFT and RIGHT, (3,) float64, mm
        Where the coronaries begin, in place of the found ones.
    narrow : (n,) bool
        Places of the layer that main branches go round, as far as that isn't much longer.
    """
    epi = _epicardium(layer, places, narrow)
    front, back = places.grooves
    back += 2 * np.pi
    apart = apart_for(layer, ends)
    forest = LayerForest(layer, balance, layer.length.copy(), apart)
    apex = int(np.argmin(epi.height))
    begin = {LEFT: front + _LEFT_OF_GROOVE, RIGHT: front - _RIGHT_OF_GROOVE}
    for tree, place in ostia.items():
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


def _epicardium(layer: Layer, places: HeartPlaces, narrow: NDArray[np.bool_]) -> _Epicardium:
    height, angle = places.height(layer.points), places.angle(layer.points)
    extent = float(np.ptp(height))
    rim = _rim(height, angle)
    along = layer.points - places.middle
    radius = np.linalg.norm(along - np.outer(along @ places.base, places.base), axis=1)
    cost = np.where(narrow, _NARROW, 1.0)
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
