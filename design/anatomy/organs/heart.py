"""Grow a heart's left and right coronary artery on the epicardium, with branches into the wall."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from design.anatomy.from_trunks import LAYING, TrunkPlan
from design.anatomy.main_branches import MainBranch, missing_branches, trunk_pieces
from design.anatomy.openness import way_through
from design.anatomy.organ import AnatomicTrees, Place, Survey, Trees, grow_trees, say, survey
from design.anatomy.organs.heart_places import FEWEST, HeartPlaces, find_heart_places
from design.anatomy.perforators import with_perforators
from design.anatomy.published_radii import MATCH, trunks_mm, with_published_radii
from design.anatomy.trunk_lines import (
    Layer,
    LayerForest,
    TrunkLines,
    Zone,
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
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree
from kernels.arrays import BoolArray, FloatArray, IntArray

NAMES: Final = ("left_coronary", "right_coronary")
LEFT, RIGHT = 0, 1
"""Numbers of the two coronaries' trees."""


class _Trunks(NamedTuple):
    """How a heart's coronaries are laid; angles are about the base's direction, rad."""

    below_rim: float = 0.07  # atrioventricular groove below the epicardium's rim, over its height
    left_begins: float = float(np.radians(18.0))  # from the anterior groove
    right_begins: float = float(np.radians(38.0))
    circumflex_ends: float = float(np.radians(35.0))  # before the posterior groove: right dominance
    posterior_ends: float = 0.72  # of the way from base to apex
    waypoint: float = float(np.radians(30.0))  # between stops in the atrioventricular groove
    strict: float = 25.0  # cost of leaving a groove by the epicardium's height
    narrow: float = 6.0  # cost of a main branch's way where the wall has no room for it
    balance: float = 0.5  # of side branches, see `Rank`
    spacing: float = 0.62  # of side branches' ends, over the spacing of all ends
    offered: int = 3  # places that are tried for each end
    # Spacing of side branches over the last: long ones come first, so that a main branch parts into
    # some nearly as wide, not into many narrow ones along one long way.
    coarse: tuple[float, ...] = (8.0, 4.0, 2.0, 1.0)
    drops: int = 3  # times that the drop is raised at most where trunks are too wide for the wall
    highest: float = 7.0  # pressure drop over the given one, as in `published_match`
    # Radius over the root's at which branches of trunks take on no more terminals while there are
    # few: they may still widen to a fifth, where a trunk begins. Ours.
    widest: float = 0.17
    least_fed: int = 4  # terminals that such a branch may feed however few there are


TRUNKS = _Trunks()


@dataclass(frozen=True)
class HeartAnatomy:
    """Options of a heart's coronaries; what isn't given is found in its shape.

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
    published_radii : bool
        Change the pressure drop as little as brings most of the orders' diameters, lengths and
        ratios within the published spread (Kassab et al. 1993).
    """

    base: Place | None = None
    right: Place | None = None
    left_ostium_mm: Place | None = None
    right_ostium_mm: Place | None = None
    trunk_ends: int = 600
    trunk_depth_mm: float = 0.3
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
    highest = TRUNKS.highest * options.pressure_drop_pa
    narrower, before = options, None
    for left in range(TRUNKS.drops, -1, -1):
        try:
            made = _grow(tissue, narrower, anatomy)
            break
        except NoRoomError as error:
            drop = narrower.pressure_drop_pa * error.drop_factor
            if not (free and left and drop <= highest and error.nearer_than(before)):
                raised = narrower.pressure_drop_pa / options.pressure_drop_pa
                tried = "" if narrower is options else f" ({_mmhg(narrower)} mmHg were tried last)"
                raise error.around(after=tried).beyond(raised) from error
            narrower, before = replace(narrower, pressure_drop_pa=drop), error
    return replace(made, notes=(*made.notes, *_drop_note(made.trees[0], options, narrower)))


def _mmhg(options: GrowthOptions) -> str:
    return f"{options.pressure_drop_pa / PA_PER_MMHG:.3g}"


def _grow(tissue: Tissue, options: GrowthOptions, anatomy: HeartAnatomy) -> AnatomicTrees:
    """Grow the coronaries with the options' pressure drop, or one nearer to published radii."""
    given = dict(zip(NAMES, (anatomy.left_ostium_mm, anatomy.right_ostium_mm), strict=True))
    shape = survey("heart", tissue, options, anatomy.trunk_ends, given)
    places = find_heart_places(shape.samples, _vector(anatomy.base), _vector(anatomy.right))
    lines, branches, notes = _trunk_lines(shape, places, options, anatomy)
    # By Murray's law; each coronary has half of the terminals.
    few = (2.0 * TRUNKS.least_fed / options.terminals) ** (1.0 / options.murray_exponent)
    plan = TrunkPlan(
        lines,
        anatomy.trunk_depth_mm,
        branches=lambda lines, radius: with_perforators(
            tissue, lines, radius, shape.volume, options
        ),
        widest_branch=float(max(TRUNKS.widest, few)),
        main=branches,
    )
    trees = grow_trees(tissue, plan, options)
    if anatomy.published_radii:
        trees = with_published_radii(trees, tissue, plan, options)
    notes = (
        *notes,
        *_left_out_note(plan.lines, trees),
        *missing_branches(branches, trunk_pieces(trees)),
    )
    return AnatomicTrees(trees, (VesselKind.ARTERY,) * 2, NAMES, notes)


def _vector(place: Place | None) -> FloatArray | None:
    return None if place is None else np.array(place, dtype=np.float64)


def _drop_note(
    tree: VesselTree, options: GrowthOptions, narrower: GrowthOptions
) -> tuple[str, ...]:
    """Note a pressure drop that was changed for thin walls or for published radii."""
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
    """Note branches of trunks that don't fit."""
    ends = np.flatnonzero(lines.parent >= 0)
    pieces = lines.points[ends] - lines.points[lines.parent[ends]]
    planned, laid = float(np.linalg.norm(pieces, axis=1).sum()), trunks_mm(trees)
    if laid > MATCH.laid * planned:
        return ()
    return (
        f"trunks are {laid:.0f} mm long, {planned:.0f} mm were planned: branches that didn't fit "
        "were left out; a higher pressure_drop_mmhg or fewer trunk_ends leave them room",
    )


def _trunk_lines(
    shape: Survey, places: HeartPlaces, options: GrowthOptions, anatomy: HeartAnatomy
) -> tuple[TrunkLines, tuple[MainBranch, ...], tuple[str, ...]]:
    """Lay both coronaries below the epicardium; with main branches and notes."""
    tissue, mine = shape.tissue, places.epicardium
    points, inward = shape.samples.points[mine], shape.samples.inward[mine]
    depth = guide_depth(tissue, points, inward, anatomy.trunk_depth_mm)
    below, deep = below_surface(tissue, points, inward, depth)
    layer = join_layer(tissue, below[deep], 0.5 * depth)
    wide = LAYING.depth_margin * likely_radius(tissue, options) + options.clearance_mm
    epi = _Epicardium.of(layer, places, _narrow_places(tissue, layer, wide))
    forest, branches = _main_trunks(epi, places, shape.given)
    spacing = TRUNKS.spacing * Zone.of(layer, 2).spacing_mm(shape.ends)
    sites = spread_sites(layer.points, TRUNKS.offered * shape.ends, forest.taken)
    for coarse in TRUNKS.coarse:
        forest.join(sites, coarse * spacing, TRUNKS.balance, layer.length)
    begins = [_begin(forest, tree, shape.given) for tree in (LEFT, RIGHT)]
    ostia = {t: ostium_above(tissue, layer.points[i], places.base) for t, i in enumerate(begins)}
    guess = (
        "no cavity opens in this shape, so that it may not be a heart's: base and right side are "
        "guesses from its outline; give base_direction and right_direction",
    )
    hollow = (~shape.samples.outer).mean() >= FEWEST
    notes = (
        *(() if hollow else guess),
        f"the heart's base was taken to lie towards {say(places.base)}, its right side "
        f"towards {say(places.right)}",
        *places.doubts,
        "ostia: " + ", ".join(f"{NAMES[tree]} at {say(at)} mm" for tree, at in ostia.items()),
    )
    return lines_of(forest, ostia, shape.volume), branches, notes


def _begin(forest: LayerForest, tree: int, given: dict[str, FloatArray]) -> int:
    """Return the number of the place in the layer where a coronary begins."""
    places = np.flatnonzero((forest.parent == -1) & (forest.tree == tree))
    if len(places) == 0:
        text = ", ".join(f"{name} near {tuple(at.tolist())}" for name, at in given.items())
        raise GrowthError(
            f"{NAMES[tree]} finds no place of its own to begin (given: {text or 'none'}); "
            "give left_coronary and right_coronary places further apart"
        )
    return int(places[0])


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

    @staticmethod
    def of(layer: Layer, places: HeartPlaces, narrow: BoolArray) -> _Epicardium:
        """Measure a layer; main branches go round ``narrow`` places (n,)."""
        height, angle = places.height(layer.points), places.angle(layer.points)
        extent = float(np.ptp(height))
        along = layer.points - places.middle
        radius = np.linalg.norm(along - np.outer(along @ places.base, places.base), axis=1)
        ring = _rim(height, angle) - TRUNKS.below_rim * extent
        cost = np.where(narrow, TRUNKS.narrow, 1.0)
        return _Epicardium(layer, height, angle, ring, extent, radius, cost)

    def at_ring(self, angle: float) -> int:
        """Return the place in the atrioventricular groove at an angle."""
        off = np.abs(wrapped(self.angle - angle)) * np.maximum(self.radius, 1e-9)
        away = off + 2.0 * np.abs(self.height - self.ring)
        return int(np.argmin(away + (self.cost - 1.0) * 0.05 * self.extent))

    def along_ring(self, begin: float, end: float) -> IntArray:
        """Return places from one angle to another through the groove, each once."""
        weight = self.cost * (1.0 + TRUNKS.strict * np.abs(self.height - self.ring) / self.extent)
        steps = max(1, round(abs(end - begin) / TRUNKS.waypoint))
        stops = [self.at_ring(angle) for angle in np.linspace(begin, end, steps + 1)]
        path = [stops[0]]
        for one, two in pairwise(stops):
            for place in cheapest_path(self.layer, weight, one, two)[1:].tolist():
                if place in path:
                    del path[path.index(place) + 1 :]
                else:
                    path.append(place)
        return np.array(path, dtype=np.int64)

    def along_groove(self, start: int, angle: float, end: int) -> IntArray:
        """Return places from ``start`` down a groove to ``end``."""
        off = np.abs(wrapped(self.angle - angle)) * self.radius
        weight = self.cost * (1.0 + TRUNKS.strict * off / self.extent)
        return cheapest_path(self.layer, weight, start, end)


def wrapped(angle: FloatArray) -> FloatArray:
    """Return angles between -π and π."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _main_trunks(
    epi: _Epicardium, places: HeartPlaces, ostia: dict[str, FloatArray]
) -> tuple[LayerForest, tuple[MainBranch, ...]]:
    """Lay the main branches of both coronaries, which begin near given ostia.

    Left: down the anterior interventricular groove round the apex, and to the left through the
    atrioventricular groove. Right: through it to the crux, then down the posterior groove.
    """
    points, forest = epi.layer.points, LayerForest(epi.layer)
    front, back = places.grooves
    back += 2 * np.pi
    apex = int(np.argmin(epi.height))
    begin = [front + TRUNKS.left_begins, front - TRUNKS.right_begins]
    for name, place in ostia.items():
        begin[NAMES.index(name)] = float(places.angle(place[None])[0])
    left = epi.along_ring(begin[LEFT], back - TRUNKS.circumflex_ends)
    right = epi.along_ring(begin[RIGHT], back - 2 * np.pi)
    for tree, path in ((LEFT, left), (RIGHT, right)):
        forest.plant(tree, int(path[0]))
    down = epi.along_groove(int(left[0]), front, apex)
    for path in (down, left, right):
        _extend_free(forest, path)
    # A right coronary that meets the left one ends there.
    crux = int(right[forest.tree[right] == RIGHT][-1])
    lowest = epi.height[crux] + TRUNKS.posterior_ends * (epi.height[apex] - epi.height[crux])
    off = np.abs(wrapped(epi.angle - back)) * epi.radius + np.abs(epi.height - lowest)
    posterior = epi.along_groove(crux, back, int(np.argmin(off)))
    _extend_free(forest, posterior)
    return forest, (
        MainBranch("left anterior descending branch", LEFT, points[down], True),
        MainBranch("left circumflex branch", LEFT, points[left], True),
        MainBranch("right coronary's trunk", RIGHT, points[right], True),
        MainBranch("posterior descending branch", RIGHT, points[posterior]),
    )


class _Wall(NamedTuple):
    """How deep trunks are planned."""

    guide_mm: float = 1.0  # where walls allow it
    shallower: float = 0.8  # depth that is tried next, over the one before
    covered: float = 0.8  # of the epicardium, what must be so deep
    least_covered: float = 0.5  # the same at the least depth
    deep: float = 0.95  # of a main branch's depth, what a place must have
    to_ostium: float = 12.0  # way from a coronary's begin to its ostium, at most, over its depth


WALL = _Wall()


def guide_depth(tissue: Tissue, points: FloatArray, inward: FloatArray, least_mm: float) -> float:
    """Return the depth below the epicardium's points (n, 3) at which trunks are planned, mm.

    Raises
    ------
    TissueError
        Where most of the wall has no room at ``least_mm`` either.
    """
    depth = max(WALL.guide_mm, least_mm)
    while True:
        deep = below_surface(tissue, points, inward, depth)[1]
        if deep.mean() >= (WALL.covered if depth > least_mm else WALL.least_covered):
            return depth
        if depth <= least_mm:
            raise _too_thin(tissue, points[~deep], inward[~deep], least_mm, float(deep.mean()))
        depth = max(WALL.shallower * depth, least_mm)


def _too_thin(
    tissue: Tissue, points: FloatArray, inward: FloatArray, depth_mm: float, covered: float
) -> TissueError:
    """Return the error for walls below whose ``points`` (n, 3) no trunk fits at a depth."""
    thick = np.minimum(way_through(tissue, points, inward), 2.0 * depth_mm)
    middle = int(np.argsort(thick)[len(thick) // 2])
    x, y, z = points[middle]
    return TissueError(
        f"the heart's walls are too thin for coronaries: near ({x:.4g}, {y:.4g}, {z:.4g}) mm "
        f"{thick[middle]:.2g} mm thick, and below {1.0 - covered:.0%} of the epicardium thinner "
        f"than the {2.0 * depth_mm:.2g} mm that a trunk_depth_mm of {depth_mm:g} needs; give a "
        f"trunk_depth_mm of {0.4 * float(np.percentile(thick, 20)):.2g}, or a mesh of thicker walls"
    )


def _narrow_places(tissue: Tissue, layer: Layer, depth_mm: float) -> BoolArray:
    """Return places (n,) of the layer below which the tissue isn't so deep."""
    deeper = depth_mm + tissue.grid.distance(layer.points)
    below = layer.points - deeper[:, None] * outward(tissue, layer.points)
    return np.asarray(-tissue.grid.distance(below) < WALL.deep * depth_mm)


def ostium_above(tissue: Tissue, place: FloatArray, up: FloatArray) -> FloatArray:
    """Return where a line from a place towards the base leaves the tissue, (3,), mm.

    Where that is far, the nearest place of the surface.
    """
    depth = -float(tissue.grid.distance(place[None])[0])
    for direction in (up[None], outward(tissue, place[None])):
        far = way_through(tissue, place[None], direction)[0]
        if far <= WALL.to_ostium * depth:
            ostium: FloatArray = place + far * direction[0]
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


def _rim(height: FloatArray, angle: FloatArray, sectors: int = 36) -> FloatArray:
    """Return height of the epicardium's upper rim at each angle, evened over three sectors."""
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
