"""Grow a brain cortex's artery from its pial side: surface branches, then arterioles inward."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from design.anatomy.from_trunks import TrunkPlan, clear_trunks
from design.anatomy.grown import AnatomicTrees, grow_apart, trunk_ends
from design.anatomy.openness import SurfaceSamples, sample_surface
from design.anatomy.trunk_lines import (
    Layer,
    LayerForest,
    TrunkLines,
    apart_for,
    below_surface,
    join_layer,
    lines_of,
    outward,
    spread_sites,
    with_shares,
)
from design.errors import LEAST_IN_CORTEX, TissueError
from design.network import VesselKind
from design.tissue import Tissue
from design.vasculature.growth.parts import check_inlet
from design.vasculature.growth.supply import check_one_part, demand_points
from design.vasculature.options import GrowthOptions
from kernels.arrays import FloatArray, IntArray

Place = tuple[float, float, float]
ARTERIOLES_PER_MM2 = 1.0
"""Precortical arteries of the human brain, of some 60 µm, serve 1 mm² of its surface each
(Akima et al. 2003, doi 10.1046/j.1440-1789.2003.00487.x, abstract)."""
SHALLOWEST, DEEPEST = 0.3, 0.9
"""Depths to which arterioles go, over the thickness, spread evenly. Duvernoy et al. 1981
(doi 10.1016/0361-9230(81)90007-1) tell five groups by depth, but no shares: these are ours."""
_SAMPLES = 12_000
_VOLUME = 20_000
_GOLDEN = 0.6180339887498949
_DISK = 0.7
"""Of places drawn at least s apart there are about 0.7 / s² (random sequential adsorption's 0.547
for disks of diameter s is 0.70 / s² in number)."""


@dataclass(frozen=True)
class CortexAnatomy:
    """What a cortex's vessels are told; what isn't is found in its shape.

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
    ends = trunk_ends(anatomy.trunk_ends, options.terminals, "cortex", least=LEAST_IN_CORTEX)
    check_inlet(tissue, "pial_artery", anatomy.entry_mm)
    check_one_part(tissue)
    samples = sample_surface(tissue, _SAMPLES, options.seed)
    way = None if anatomy.pial_direction is None else np.array(anatomy.pial_direction)
    places = find_cortex_places(tissue, samples, way, anatomy.thickness_mm)
    points, inward = samples.points[places.pial], samples.inward[places.pial]
    depth = max(2.0 * tissue.grid.spacing_mm, anatomy.trunk_depth_mm)
    below, deep = below_surface(tissue, points, inward, depth)
    layer = join_layer(tissue, below[deep], 0.5 * depth)
    begin = _begin(layer, anatomy.entry_mm)
    forest = LayerForest(layer, 0.25, layer.length.copy(), apart_for(layer, ends))
    forest.plant(0, begin)
    forest.join(spread_sites(layer.points, 3 * ends, layer.points[begin][None]))
    volume, _ = demand_points(tissue, _VOLUME, options.seed)
    place = layer.points[begin]
    entry = points[int(np.argmin(np.linalg.norm(points - place, axis=1)))]
    rule = _rule(tissue, places, len(points) / len(samples.points), anatomy, options)
    plan = TrunkPlan(
        lines_of(forest, {0: entry}, volume),
        anatomy.trunk_depth_mm,
        branches=lambda lines, radius: with_arterioles(
            tissue, lines, radius, rule, volume, options
        ),
    )
    trees = grow_apart(tissue, plan, options)
    return AnatomicTrees(trees, (VesselKind.ARTERY,), ("pial_artery",), _notes(places, rule, entry))


@dataclass(frozen=True)
class ArterioleRule:
    """Where arterioles leave: ``apart_mm`` from each other; and the cortex's thickness, mm."""

    apart_mm: float
    thickness_mm: float
    count: float


def _rule(
    tissue: Tissue,
    places: CortexPlaces,
    part: float,
    anatomy: CortexAnatomy,
    options: GrowthOptions,
) -> ArterioleRule:
    corners = tissue.surface.vertices[tissue.surface.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = part * float(0.5 * np.linalg.norm(across, axis=1).sum())
    count = min(anatomy.arterioles_per_mm2 * area, options.terminals / 3.0)
    return ArterioleRule(float(np.sqrt(_DISK * area / count)), places.thickness_mm, count / area)


def with_arterioles(
    tissue: Tissue,
    lines: TrunkLines,
    radius: FloatArray,
    rule: ArterioleRule,
    volume: FloatArray,
    options: GrowthOptions,
) -> tuple[TrunkLines, FloatArray]:
    """Pial lines with arterioles that leave them at right angles to the surface, and their radii.

    All ends of pial arteries dive, and as many other places as are ``apart_mm`` from those.
    """
    nodes = _apart(lines, rule.apart_mm)
    inward = -outward(tissue, lines.points[nodes])
    thick = depth_along_normal(tissue, lines.points[nodes], inward)
    part = SHALLOWEST + (DEEPEST - SHALLOWEST) * ((_GOLDEN * np.arange(len(nodes))) % 1.0)
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
    whole = with_shares(whole, volume)
    own = radius.max() * whole.share[count:] ** (1.0 / options.murray_exponent)
    return _without_those_in_the_way(tissue, whole, np.concatenate([radius, own]), options)


def _without_those_in_the_way(
    tissue: Tissue, lines: TrunkLines, radius: FloatArray, options: GrowthOptions
) -> tuple[TrunkLines, FloatArray]:
    while True:
        clearer = clear_trunks(tissue, lines, lines, radius, options, later=False)
        if clearer is None:
            return lines, radius
        lines, radius = clearer


def _apart(lines: TrunkLines, apart_mm: float) -> IntArray:
    """Nodes of at most one child, ends first, each so far from the others."""
    count = lines.child_count()
    free = np.flatnonzero((lines.parent >= 0) & (count <= 1))
    order = free[np.argsort(count[free], kind="stable")]
    near = cKDTree(lines.points[order]).query_ball_point(lines.points[order], apart_mm)
    taken = np.zeros(len(order), dtype=np.bool_)
    gone = np.zeros(len(order), dtype=np.bool_)
    for n in range(len(order)):
        if not gone[n]:
            taken[n] = True
            gone[near[n]] = True
    return np.asarray(order[taken], dtype=np.int64)


def _begin(layer: Layer, entry: Place | None) -> int:
    """The place of the layer where the pial artery begins."""
    if entry is not None:
        return layer.nearest(np.array(entry))
    away = np.linalg.norm(layer.points - layer.points.mean(axis=0), axis=1)
    return int(np.argmax(away))


def _notes(places: CortexPlaces, rule: ArterioleRule, entry: FloatArray) -> tuple[str, ...]:
    say = "({:.3g}, {:.3g}, {:.3g})"
    way = "all ways" if places.closed else f"towards {say.format(*places.outward)}"
    return (
        f"the pial side was taken to look {way}; the artery enters at {say.format(*entry)} mm",
        f"the grey matter is {places.thickness_mm:.3g} mm thick; {rule.count:.2g} arterioles per "
        "mm² were asked for",
    )


# Find a cortex's pial (outer) side, its mean outward direction and thickness from its shape.

_NEIGHBOURS = 12
_SAME_SIDE = 0.7
"""Cosine between normals of neighbours on one side; rims are sharper."""
_SHEET = 0.2
"""Thickness over the extent above which a shape is no sheet: all its surface is pial."""
_ALL_WAYS = 0.1
"""Length of a side's mean normal below which it looks all ways."""
_ALIKE = 0.95
"""Share of the larger side from which on two count as equally large."""


@dataclass(frozen=True)
class CortexPlaces:
    """Places of a cortex.

    Attributes
    ----------
    pial : (k,) int64
        Numbers of the surface samples on the pial side.
    outward : (3,) float64
        Mean normal of that side, a unit vector.
    thickness_mm : float
        Median along the normal, or as it is given.
    closed : bool
        Whether that side looks all ways, as a hemisphere's does: it has no mean normal.
    """

    pial: IntArray
    outward: FloatArray
    thickness_mm: float
    closed: bool = False


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
    every = depth_along_normal(tissue, samples.points, samples.inward)
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
        alike = size >= _ALIKE * size.max()
        best = int(np.argmax(np.where(alike, [each[2] for each in normal], -np.inf)))
    pial = sides[best]
    deep = every[pial]
    outward = normal[best]
    length = float(np.linalg.norm(outward))
    return CortexPlaces(
        pial,
        outward / max(length, 1e-12),
        float(np.median(deep)) if thickness_mm is None else thickness_mm,
        length < _ALL_WAYS * len(pial),
    )


def depth_along_normal(tissue: Tissue, points: FloatArray, inward: FloatArray) -> FloatArray:
    """Way (n,) from surface points (n, 3) along ``inward`` (n, 3) to where they leave, mm."""
    least = 0.25 * tissue.grid.spacing_mm
    low, high = tissue.bounds
    far = float(np.linalg.norm(high - low))
    gone = np.full(len(points), 4.0 * least)
    going = np.arange(len(points))
    while len(going):
        room = -tissue.grid.distance(points[going] + gone[going, None] * inward[going])
        on = (room > 0.0) & (gone[going] < far)
        gone[going[on]] += np.maximum(room[on], least)
        going = going[on]
    return gone


def _sides(samples: SurfaceSamples, deep: FloatArray) -> list[IntArray]:
    """Samples of each side of a sheet; of a solid body all samples, as one."""
    points, inward = samples.points, samples.inward
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    if np.median(deep) > _SHEET * extent:
        return [np.arange(len(points))]
    index = cKDTree(points)
    near = index.query(points, _NEIGHBOURS)[1]
    same = np.einsum("nkx,nx->nk", inward[near], inward) > _SAME_SIDE
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
            if not side[other] and facing[there] < -_SAME_SIDE:
                side[other] = -side[here]
                queue.append(other)
    return [np.flatnonzero(side == 1), np.flatnonzero(side == -1)]
