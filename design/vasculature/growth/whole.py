"""Grow trees that together reach all of one connected tissue."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from design.network import VesselKind
from design.tissue import Tissue
from design.vasculature.growth.deep_roots import deep_roots
from design.vasculature.growth.forest import RootSpec, grow_forest
from design.vasculature.growth.grow import grow_tree
from design.vasculature.growth.unreached import Unreached, unreached
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree

FloatArray = NDArray[np.float64]

ROUNDS = 5
"""Growths with more inlets each time, until all of the tissue is reached."""

INLETS_A_ROUND = 4
_PLACES = 400


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
        Where the trees leave a large place out, give it an inlet of its own and grow anew.

    Raises
    ------
    TissueError, GrowthError
        As `grow_forest`.
    """
    few, more = divmod(terminals, len(roots))
    wish = [replace(root, terminals=few + (n < more)) for n, root in enumerate(roots)]
    trees = _trees(tissue, wish)
    if not more_inlets:
        return trees
    for _ in range(ROUNDS):
        ends = np.concatenate([tree.distal[tree.children[:, 0] < 0] for tree in trees])
        missed = unreached(tissue, ends)[:INLETS_A_ROUND]
        if not missed:
            break
        wish = _with_inlets(tissue, wish, trees, missed)
        trees = _trees(tissue, wish)
    added = len(trees) - len(roots)
    if not added:
        return trees
    note = (
        f"Vessels from one inlet don't reach all of the tissue, so {added} more were added, at "
        + ", ".join("({:.4g}, {:.4g}, {:.4g}) mm".format(*t.proximal[0]) for t in trees[-added:])
    )
    return (replace(trees[0], notes=(*trees[0].notes, note)), *trees[1:])


def _trees(tissue: Tissue, wish: Sequence[GrowthOptions]) -> tuple[VesselTree, ...]:
    if len(wish) == 1:
        return (grow_tree(tissue, wish[0]),)
    return grow_forest(tissue, [RootSpec(one, VesselKind.ARTERY) for one in wish])


def _with_inlets(
    tissue: Tissue,
    wish: Sequence[GrowthOptions],
    trees: Sequence[VesselTree],
    missed: Sequence[Unreached],
) -> list[GrowthOptions]:
    """The roots as they grew, and one for each place missed, with its share of the terminals."""
    found = [
        _at(one, tree.proximal[0], tree.distal[0] - tree.proximal[0])
        for one, tree in zip(wish, trees, strict=True)
    ]
    places = deep_roots(tissue, _PLACES, wish[0].seed, apart=0.0)
    taken = [tree.proximal[0] for tree in trees]
    total = sum(one.terminals for one in wish)
    for place in missed:
        away, _ = KDTree(place.points).query(places[0])
        apart = np.linalg.norm(places[0][:, None] - np.array(taken)[None], axis=2).min(axis=1)
        best = int(np.argmin(np.where(apart > 0, away, np.inf)))
        taken.append(places[0][best])
        count = max(2, round(place.share * total))
        largest = int(np.argmax([one.terminals for one in found]))
        count = min(count, found[largest].terminals - 2)
        if count < 1:
            continue
        found[largest] = replace(found[largest], terminals=found[largest].terminals - count)
        new = _at(wish[0], places[0][best], places[1][best])
        found.append(replace(new, terminals=count))
    return found


def _at(options: GrowthOptions, point: FloatArray, way: FloatArray) -> GrowthOptions:
    x, y, z = point.tolist()
    dx, dy, dz = way.tolist()
    return replace(options, root_candidates=0, root_point_mm=(x, y, z), root_direction=(dx, dy, dz))
