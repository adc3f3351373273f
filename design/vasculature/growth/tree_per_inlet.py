"""Grow a vessel tree from each inlet of a connected tissue; add inlets for unreached regions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from design.network import VesselKind
from design.tissue import Tissue
from design.vasculature.growth.forest import RootSpec, grow_forest
from design.vasculature.growth.grow import grow_tree
from design.vasculature.growth.points import share_terminals
from design.vasculature.growth.root import deep_roots
from design.vasculature.growth.supply import Probes, probes_for, unreached
from design.vasculature.growth.territories import Surroundings
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree
from kernels.arrays import FloatArray

ROUNDS = 5
"""Growths with more inlets each time, until all of the tissue is reached."""

INLETS_A_ROUND = 4
_PLACES = 2000
_LEAST = 2


def grow_whole(
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
    for _ in range(ROUNDS):
        ends = np.concatenate([tree.distal[tree.children[:, 0] < 0] for tree in trees])
        missed = unreached(tissue, ends, probes)[:INLETS_A_ROUND]
        if not missed:
            break
        if len(trees) == 1:
            settings = [
                _at(options, trees[0].proximal[0], trees[0].distal[0] - trees[0].proximal[0])
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
    count = share_terminals(share, np.full(len(settings), _LEAST), terminals)
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
    places, ways = deep_roots(tissue, _PLACES, options.seed, apart=0.0)
    ahead = places + 0.5 * probes.reach_mm * ways
    first = np.isin(KDTree(probes.points).query(ahead)[1], members)
    others = np.array([one.root_point_mm for one in taken])
    apart = KDTree(others).query(places)[0]
    good = np.flatnonzero(first & (apart > probes.reach_mm))
    if len(good):
        best = int(good[0])
    else:
        best = int(np.argmin(KDTree(probes.points[members]).query(ahead)[0]))
    return _at(options, places[best], ways[best])


def _at(options: GrowthOptions, point: FloatArray, way: FloatArray) -> GrowthOptions:
    x, y, z = point.tolist()
    dx, dy, dz = way.tolist()
    return replace(options, root_candidates=0, root_point_mm=(x, y, z), root_direction=(dx, dy, dz))
