"""Grow vessel trees in all unconnected parts of a tissue; report the supply of each part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from design.errors import DesignError, GrowthError, TissueError
from design.geometry import build_triangle_tree, nearest_distance
from design.network import VesselKind, VesselNetwork
from design.tissue import Part, Tissue, part_demands, part_numbers, part_tissue, parts_of
from design.vasculature.growth.forest import RootSpec, forest_to_network, grow_forest
from design.vasculature.growth.kernels.points import share_terminals
from design.vasculature.growth.root import rooted_at
from design.vasculature.growth.root_search import deep_roots
from design.vasculature.growth.supply import (
    PartSupply,
    Probes,
    check_supply,
    no_inlet,
    no_way,
    probes_for,
    unreached,
)
from design.vasculature.growth.territories import Surroundings
from design.vasculature.growth.tree import grow_tree
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_to_network
from kernels.arrays import FloatArray

Place = tuple[float, float, float]


class InletSettings(NamedTuple):
    """Limits on inlets, given or added."""

    max_distance: float = 0.1
    """From the surface, over the tissue's largest extent, at which an inlet may be given."""
    max_rounds: int = 5
    per_round: int = 4
    """Growths with more inlets each time until all of the tissue is reached; inlets added to
    each."""
    places: int = 2000
    """Candidates on the surface for an added inlet."""
    min_terminals: int = 2
    """Of each inlet."""


INLETS = InletSettings()


@dataclass(frozen=True)
class Inlet:
    """Where a tree enters, mm; ``direction`` is the inward normal there by default."""

    point_mm: Place
    direction: Place | None = None


@dataclass(frozen=True)
class GrownParts:
    """The trees of a tissue's parts.

    Attributes
    ----------
    trees : tuple of VesselTree
    supply : tuple of PartSupply
        Of each part, the largest first.
    notes : tuple of str
        What the user should know.
    """

    trees: tuple[VesselTree, ...]
    supply: tuple[PartSupply, ...]
    notes: tuple[str, ...] = ()


def grow_parts(tissue: Tissue, options: GrowthOptions, inlets: Sequence[Inlet] = ()) -> GrownParts:
    """Grow a tree in every part of a tissue, or several, so that each gets what it asks for.

    Terminals and flow are shared among the parts by demand (by volume where it is uniform); each
    part gets one terminal at least. All trees have the same pressure drop, so that inlets on one
    supply share its flow as designed; with a smallest radius the drops differ, and the notes say
    what each part then gets.

    Parameters
    ----------
    tissue : Tissue
    options : GrowthOptions
        Of all trees together; a root point is that of the part it lies nearest to.
    inlets : sequence of Inlet, optional
        By default each part has one of its own. An inlet belongs to the part it lies nearest to;
        several in a part share it evenly.

    Raises
    ------
    TissueError
        When a part is left without an inlet, no vessel fits in it, or an inlet is far off; by name,
        size and place.
    GrowthError
        As `grow_tree`; when there are fewer terminals than inlets; and for options that only one
        tree takes (stages, a root searched for) where there are several.
    """
    parts = parts_of(tissue)
    demand = part_demands(tissue, parts)
    roots = _roots(tissue, parts, options, inlets)
    left = [n for n, own in enumerate(roots) if not own and demand[n] > 0]
    if left:
        raise TissueError(no_inlet(parts, left))
    if len(parts) == 1 and len(roots[0]) == 1:
        trees = list(_grow_part(tissue, roots[0], options.terminals, more_inlets=not inlets))
    else:
        trees = _grown(tissue, parts, demand, roots, options, bool(inlets))
    ends, flow = terminals_of(trees)
    missed = () if inlets else unreached(tissue, ends)
    if missed:
        raise TissueError(no_way(missed))
    supply, uneven = check_supply(tissue, ends, flow)
    notes = [note for tree in trees for note in tree.notes]
    return GrownParts(tuple(trees), supply, (*notes, *uneven))


def check_inlet(tissue: Tissue, name: str, place: Place | None) -> None:
    """Refuse a place that is far from the tissue's surface; None is taken.

    Raises
    ------
    TissueError
        When it is farther away than a tenth of the tissue's largest extent.
    """
    if place is None:
        return
    tree = build_triangle_tree(tissue.surface.vertices, tissue.surface.faces)
    most = INLETS.max_distance * float(np.ptp(tissue.bounds, axis=0).max())
    away = float(nearest_distance(tree, *place, np.inf))
    if away > most:
        raise TissueError(
            f"{name} at {place} mm is {away:.3g} mm from the tissue's surface (limit {most:.3g}, a "
            "tenth of its extent); give a place on the surface"
        )


def terminals_of(trees: Sequence[VesselTree]) -> tuple[FloatArray, FloatArray]:
    """Ends of all terminals (n, 3), mm, and their flows (n,) with all inlets at one pressure."""
    tips = [tree.children[:, 0] < 0 for tree in trees]
    ends = [tree.distal[tip] for tree, tip in zip(trees, tips, strict=True)]
    flows = [
        tree.flow_ul_s[tip] / tree.pressure_drop_pa for tree, tip in zip(trees, tips, strict=True)
    ]
    return np.concatenate(ends), np.concatenate(flows)


def parts_to_network(grown: GrownParts) -> VesselNetwork:
    """All trees as one network of arteries, a tree's number in `tree`."""
    if len(grown.trees) == 1:
        return tree_to_network(grown.trees[0], VesselKind.ARTERY)
    return forest_to_network(grown.trees, [VesselKind.ARTERY] * len(grown.trees))


def _roots(
    tissue: Tissue, parts: Sequence[Part], options: GrowthOptions, inlets: Sequence[Inlet]
) -> list[list[GrowthOptions]]:
    """For each part the options of its trees, by their roots; terminals aren't shared yet."""
    if inlets and (options.root_point_mm is not None or options.root_candidates):
        raise GrowthError("give either inlets or a root, and not both")
    of_parts: list[list[GrowthOptions]] = [[] for _ in parts]
    bare = replace(options, root_point_mm=None, root_direction=None)
    for number, inlet in enumerate(inlets, 1):
        check_inlet(tissue, f"inlet {number}", inlet.point_mm)
        own = replace(bare, root_point_mm=inlet.point_mm, root_direction=inlet.direction)
        of_parts[_nearest_part(tissue, parts, inlet.point_mm)].append(own)
    if inlets:
        return of_parts
    for own_roots in of_parts:
        own_roots.append(bare)
    if options.root_point_mm is not None:
        of_parts[_nearest_part(tissue, parts, options.root_point_mm)] = [options]
    return of_parts


def _nearest_part(tissue: Tissue, parts: Sequence[Part], place: Place) -> int:
    """The part that a place lies in, or nearest to."""
    inside = int(part_numbers(tissue, parts, np.array([place]))[0])
    if inside >= 0 or len(parts) == 1:
        return max(inside, 0)
    trees = [build_triangle_tree(tissue.surface.vertices, part.faces) for part in parts]
    return int(np.argmin([nearest_distance(tree, *place, np.inf) for tree in trees]))


def _grown(
    tissue: Tissue,
    parts: Sequence[Part],
    demand: FloatArray,
    roots: list[list[GrowthOptions]],
    options: GrowthOptions,
    inlets_given: bool,
) -> list[VesselTree]:
    """Grow the trees of each part that asks for any."""
    if options.stages or options.terminal_points_mm is not None:
        raise GrowthError(
            "stages and given terminals go with a single tree; leave them out, or take one part of "
            "the tissue and one inlet"
        )
    least = np.array(
        [len(own) if share > 0 else 0 for own, share in zip(roots, demand, strict=True)]
    )
    count = share_terminals(demand, least, options.terminals)
    trees: list[VesselTree] = []
    for n, part in enumerate(parts):
        if count[n] == 0:
            continue
        own = part_tissue(tissue, part)
        flow = options.perfusion_ml_min_per_ml * tissue.volume_mm3 * demand[n] / own.volume_mm3
        settings = [replace(root, perfusion_ml_min_per_ml=flow) for root in roots[n]]
        try:
            trees += _grow_part(own, settings, int(count[n]), more_inlets=not inlets_given)
        except DesignError as error:
            raise TissueError(f"{part} can't be supplied: {error}") from error
    return trees


def _grow_part(
    tissue: Tissue, roots: Sequence[GrowthOptions], terminals: int, *, more_inlets: bool
) -> tuple[VesselTree, ...]:
    """Grow a tree from each root, with the terminals shared evenly among them.

    Parameters
    ----------
    tissue : Tissue
    roots : sequence of GrowthOptions
        One for each tree, with its root; its terminals don't count.
    terminals : int
    more_inlets : bool
        Where the tree of a single root leaves a large place out, give that place an inlet of its
        own and grow anew.

    Raises
    ------
    TissueError, GrowthError
        As `grow_forest`.
    """
    few, more = divmod(terminals, len(roots))
    settings = [replace(root, terminals=few + (n < more)) for n, root in enumerate(roots)]
    if len(settings) > 1:
        return grow_forest(tissue, [RootSpec(one, VesselKind.ARTERY) for one in settings])
    trees: tuple[VesselTree, ...] = (grow_tree(tissue, settings[0]),)
    return _reaching(tissue, settings[0], trees) if more_inlets else trees


def _reaching(
    tissue: Tissue, options: GrowthOptions, trees: tuple[VesselTree, ...]
) -> tuple[VesselTree, ...]:
    """Trees from as many inlets as it takes to reach all of the tissue."""
    probes = probes_for(tissue, options.terminals)
    owner = np.zeros(len(probes.points), dtype=np.int64)
    settings = [options]
    for _ in range(INLETS.max_rounds):
        ends = np.concatenate([tree.distal[tree.children[:, 0] < 0] for tree in trees])
        missed = unreached(tissue, ends, probes)[: INLETS.per_round]
        if not missed:
            break
        if len(trees) == 1:
            settings = [
                rooted_at(options, trees[0].proximal[0], trees[0].distal[0] - trees[0].proximal[0])
            ]
        for place in missed:
            owner[place.members] = len(settings)
            settings.append(_root_into(tissue, options, settings, probes, place.members))
        trees = _from_plots(tissue, settings, probes, owner, options.terminals)
    if len(trees) == 1:
        return trees
    note = (
        f"Vessels from one inlet don't reach all of the tissue, so {len(trees) - 1} more "
        "were added, at "
        + ", ".join("({:.4g}, {:.4g}, {:.4g}) mm".format(*tree.proximal[0]) for tree in trees[1:])
    )
    return (replace(trees[0], notes=(*trees[0].notes, note)), *trees[1:])


def _from_plots(
    tissue: Tissue,
    settings: Sequence[GrowthOptions],
    probes: Probes,
    owner: NDArray[np.int64],
    terminals: int,
) -> tuple[VesselTree, ...]:
    """A tree from each root in its own territory, of the terminals that this asks for."""
    share = np.bincount(owner, weights=probes.asks, minlength=len(settings)).astype(np.float64)
    count = share_terminals(share, np.full(len(settings), INLETS.min_terminals), terminals)
    nearest = KDTree(probes.points)
    plots = [
        Surroundings(owns=partial(_owned, nearest, owner, n), share=float(count[n] / terminals))
        for n in range(len(settings))
    ]
    roots = [replace(one, terminals=int(k)) for one, k in zip(settings, count, strict=True)]
    return grow_forest(tissue, roots, plots)


def _owned(
    nearest: KDTree, owner: NDArray[np.int64], number: int, points: FloatArray
) -> NDArray[np.bool_]:
    """Whether the probe nearest to each point is of territory ``number``."""
    owned: NDArray[np.bool_] = owner[nearest.query(points)[1]] == number
    return owned


def _root_into(
    tissue: Tissue,
    options: GrowthOptions,
    taken: Sequence[GrowthOptions],
    probes: Probes,
    members: NDArray[np.int64],
) -> GrowthOptions:
    """A root at the deepest place whose stem leads to some probes, away from other roots."""
    places, ways = deep_roots(tissue, INLETS.places, options.seed, separation=0.0)
    ahead = places + 0.5 * probes.reach_mm * ways
    first = np.isin(KDTree(probes.points).query(ahead)[1], members)
    others = np.array([one.root_point_mm for one in taken])
    distance = KDTree(others).query(places)[0]
    good = np.flatnonzero(first & (distance > probes.reach_mm))
    if len(good):
        best = int(good[0])
    else:
        best = int(np.argmin(KDTree(probes.points[members]).query(ahead)[0]))
    return rooted_at(options, places[best], ways[best])
