"""Grow a brain cortex's artery from its pial side: surface branches, then arterioles inward."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from design.anatomy.from_trunks import TrunkPlan, clear_trunks
from design.anatomy.openness import SurfaceSamples, way_through
from design.anatomy.organ import AnatomicTrees, Place, Survey, grow_trees, say, survey
from design.anatomy.trunk_lines import (
    LayerForest,
    Rank,
    TrunkLines,
    Zone,
    below_surface,
    join_layer,
    lines_of,
    nearest,
    outward,
    with_shares,
)
from design.errors import TissueError
from design.network import VesselKind
from design.tissue import Tissue
from design.vasculature.options import GrowthOptions
from kernels.arrays import FloatArray, IntArray

ARTERIOLES_PER_MM2 = 1.0
"""Precortical arteries of the human brain, of some 60 µm, serve 1 mm² of its surface each
(Akima et al. 2003, doi 10.1046/j.1440-1789.2003.00487.x, abstract)."""
_GOLDEN = 0.6180339887498949


class _Trunks(NamedTuple):
    """How a cortex's pial arteries and arterioles are laid."""

    pial: Rank = Rank(balance=0.25, offered=3)
    # Depths to which arterioles go, over the thickness, spread evenly. Duvernoy et al. 1981
    # (doi 10.1016/0361-9230(81)90007-1) tell five groups by depth, but no shares: these are ours.
    shallowest: float = 0.3
    deepest: float = 0.9
    disk: float = 0.7  # number of places drawn at least s apart, times s² (random adsorption)


TRUNKS = _Trunks()


@dataclass(frozen=True)
class CortexAnatomy:
    """Options of a cortex's vessels; what isn't given is found in its shape.

    Attributes
    ----------
    entry_mm : (float, float, float), optional
        Near where the pial artery begins; the pial side's far end by default.
    pial_direction : (float, float, float), optional
        Out of the pial side.
    thickness_mm : float, optional
        Of the grey matter.
    trunk_ends : int
        How many ends the pial arteries have, at about.
    arterioles_per_mm2 : float
        Per area of the pial side.
    trunk_depth_mm : float
        Least depth of the pial arteries' axes.
    """

    entry_mm: Place | None = None
    pial_direction: Place | None = None
    thickness_mm: float | None = None
    trunk_ends: int = 200
    arterioles_per_mm2: float = ARTERIOLES_PER_MM2
    trunk_depth_mm: float = 0.2


def grow_cortex(
    tissue: Tissue, options: GrowthOptions, anatomy: CortexAnatomy | None = None
) -> AnatomicTrees:
    """Grow the artery of any piece of cortex.

    Pial arteries spread just below the pial side; from them arterioles go straight into the grey
    matter, at right angles to the surface, each to a depth of its own. From these the tree goes
    on.

    Raises
    ------
    TissueError, GrowthError
        Where no trunk or tree fits.
    """
    anatomy = anatomy or CortexAnatomy()
    given = {"pial_artery": anatomy.entry_mm}
    shape = survey("cortex", tissue, options, anatomy.trunk_ends, given)
    way = None if anatomy.pial_direction is None else np.array(anatomy.pial_direction)
    places = find_cortex_places(tissue, shape.samples, way, anatomy.thickness_mm)
    lines, entry = _pial_lines(shape, places, anatomy.trunk_depth_mm)
    rule = _rule(shape, places, anatomy, options)
    plan = TrunkPlan(
        lines,
        anatomy.trunk_depth_mm,
        branches=lambda lines, radius: _with_arterioles(shape, lines, radius, rule, options),
    )
    looks = "all ways" if places.closed else f"towards {say(places.outward)}"
    notes = (
        f"the pial side was taken to look {looks}; the artery enters at {say(entry)} mm",
        f"the grey matter is {places.thickness_mm:.3g} mm thick; {rule.per_mm2:.2g} arterioles per "
        "mm² were asked for",
    )
    trees = grow_trees(tissue, plan, options)
    return AnatomicTrees(trees, (VesselKind.ARTERY,), ("pial_artery",), notes)


def _pial_lines(
    shape: Survey, places: CortexPlaces, depth_mm: float
) -> tuple[TrunkLines, FloatArray]:
    """Lay one tree below the pial side, from the given place or the far end; where it enters."""
    tissue, samples = shape.tissue, shape.samples
    points, inward = samples.points[places.pial], samples.inward[places.pial]
    depth = max(2.0 * tissue.grid.spacing_mm, depth_mm)
    below, deep = below_surface(tissue, points, inward, depth)
    layer = join_layer(tissue, below[deep], 0.5 * depth)
    away = np.linalg.norm(layer.points - layer.points.mean(axis=0), axis=1)
    given = shape.given.get("pial_artery")
    begin = int(np.argmax(away)) if given is None else layer.nearest(given)
    forest = LayerForest(layer)
    forest.plant(0, begin)
    forest.grow(TRUNKS.pial, shape.ends, Zone.of(layer, 2))
    entry = points[nearest(points, layer.points[begin])]
    return lines_of(forest, {0: entry}, shape.volume), entry


class ArterioleRule(NamedTuple):
    """Where arterioles leave."""

    spacing_mm: float  # between each other
    thickness_mm: float  # of the cortex
    per_mm2: float


def _rule(
    shape: Survey, places: CortexPlaces, anatomy: CortexAnatomy, options: GrowthOptions
) -> ArterioleRule:
    corners = shape.tissue.surface.vertices[shape.tissue.surface.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    pial = len(places.pial) / len(shape.samples.points)
    area = pial * float(0.5 * np.linalg.norm(across, axis=1).sum())
    count = min(anatomy.arterioles_per_mm2 * area, options.terminals / 3.0)
    spacing = float(np.sqrt(TRUNKS.disk * area / count))
    return ArterioleRule(spacing, places.thickness_mm, count / area)


def _with_arterioles(
    shape: Survey,
    lines: TrunkLines,
    radius: FloatArray,
    rule: ArterioleRule,
    options: GrowthOptions,
) -> tuple[TrunkLines, FloatArray]:
    """Return pial lines with arterioles at right angles to the surface, and their radii.

    All ends of pial arteries dive, and as many other places as are far enough from those.
    Arterioles in each other's way are left out.
    """
    tissue = shape.tissue
    nodes = _spaced_nodes(lines, rule.spacing_mm)
    inward = -outward(tissue, lines.points[nodes])
    thick = way_through(tissue, lines.points[nodes], inward)
    even = (_GOLDEN * np.arange(len(nodes))) % 1.0
    part = TRUNKS.shallowest + (TRUNKS.deepest - TRUNKS.shallowest) * even
    long = part * np.minimum(thick, rule.thickness_mm)
    kept = long > 3.0 * tissue.grid.spacing_mm
    nodes, inward, long = nodes[kept], inward[kept], long[kept]
    tips = lines.points[nodes] + long[:, None] * inward
    middle = 0.5 * (lines.points[nodes] + tips)
    count, more = len(lines.parent), len(nodes)
    whole = TrunkLines(
        np.concatenate([lines.points, middle, tips]),
        np.concatenate([lines.parent, nodes, count + np.arange(more)]),
        np.concatenate([lines.tree, lines.tree[nodes], lines.tree[nodes]]),
        np.zeros(count + 2 * more),
    )
    whole = with_shares(whole, shape.volume)
    own = radius.max() * whole.share[count:] ** (1.0 / options.murray_exponent)
    radius = np.concatenate([radius, own])
    while (clearer := clear_trunks(tissue, whole, whole, radius, options, later=False)) is not None:
        whole, radius = clearer
    return whole, radius


def _spaced_nodes(lines: TrunkLines, spacing_mm: float) -> IntArray:
    """Return nodes of at most one child, ends first, each so far from the others."""
    count = lines.child_count()
    free = np.flatnonzero((lines.parent >= 0) & (count <= 1))
    order = free[np.argsort(count[free], kind="stable")]
    near = cKDTree(lines.points[order]).query_ball_point(lines.points[order], spacing_mm)
    taken = np.zeros(len(order), dtype=np.bool_)
    gone = np.zeros(len(order), dtype=np.bool_)
    for n in range(len(order)):
        if not gone[n]:
            taken[n] = True
            gone[near[n]] = True
    return np.asarray(order[taken], dtype=np.int64)


class _Shape(NamedTuple):
    """How a cortex's sides are found in its shape."""

    neighbours: int = 12
    same_side: float = 0.7  # cosine between normals of neighbours on one side; rims are sharper
    sheet: float = 0.2  # thickness over the extent above which all of the surface is pial
    all_ways: float = 0.1  # length of a side's mean normal below which it looks all ways
    alike: float = 0.95  # size over the larger side's from which on two count as equally large


SHAPE = _Shape()


@dataclass(frozen=True)
class CortexPlaces:
    """The pial side of a cortex."""

    pial: IntArray  # numbers of the surface samples on it
    outward: FloatArray  # its mean normal, a unit vector
    thickness_mm: float  # median along the normal, or as it is given
    closed: bool = False  # whether it looks all ways, as a hemisphere's does: no mean normal


def find_cortex_places(
    tissue: Tissue,
    samples: SurfaceSamples,
    direction: FloatArray | None = None,
    thickness_mm: float | None = None,
) -> CortexPlaces:
    """Find the pial side: the larger side of a sheet, or that of a direction.

    Of two equally large ones (a slab) the one that looks up.

    Parameters
    ----------
    direction : (3,) float64, optional
        Out of the pial side.
    thickness_mm : float, optional
        Of the grey matter, where the shape is thicker.

    Raises
    ------
    TissueError
        When the sides can't be told apart.
    """
    every = way_through(tissue, samples.points, samples.inward)
    sides = _sides(samples, every)
    if not all(len(side) for side in sides):
        raise TissueError(
            "the two sides of the sheet can't be told apart; the mesh may be too rough for a cortex"
        )
    normal = [-samples.inward[side].sum(axis=0) for side in sides]
    if direction is not None:
        best = int(np.argmax([each @ direction for each in normal]))
    else:
        size = np.array([len(side) for side in sides])
        alike = size >= SHAPE.alike * size.max()
        best = int(np.argmax(np.where(alike, [each[2] for each in normal], -np.inf)))
    pial = sides[best]
    deep = every[pial]
    outward = normal[best]
    length = float(np.linalg.norm(outward))
    return CortexPlaces(
        pial,
        outward / max(length, 1e-12),
        float(np.median(deep)) if thickness_mm is None else thickness_mm,
        length < SHAPE.all_ways * len(pial),
    )


def _sides(samples: SurfaceSamples, deep: FloatArray) -> list[IntArray]:
    """Return samples of each side of a sheet; of a solid body all samples, as one."""
    points, inward = samples.points, samples.inward
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    if np.median(deep) > SHAPE.sheet * extent:
        return [np.arange(len(points))]
    index = cKDTree(points)
    near = index.query(points, SHAPE.neighbours)[1]
    same = np.einsum("nkx,nx->nk", inward[near], inward) > SHAPE.same_side
    away, across = index.query(points + deep[:, None] * inward)
    facing = np.einsum("nx,nx->n", inward, inward[across])
    # From the place that faces its other side best, on both sides at once: rims come last.
    side = np.zeros(len(points), dtype=np.int64)
    thin = deep <= 1.1 * np.median(deep)
    seed = int(np.argmin(np.where(thin, facing + away / np.median(deep), np.inf)))
    side[seed], side[across[seed]] = 1, -1
    queue = [seed, int(across[seed])]
    for here in queue:
        for there in near[here][same[here]].tolist():
            if side[there]:
                continue
            side[there] = side[here]
            queue.append(there)
            other = int(across[there])
            if not side[other] and facing[there] < -SHAPE.same_side:
                side[other] = -side[here]
                queue.append(other)
    return [np.flatnonzero(side == 1), np.flatnonzero(side == -1)]
