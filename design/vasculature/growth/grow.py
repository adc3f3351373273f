"""Grow one tree by constrained constructive optimisation; on failure retry, or try deeper roots."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import replace

from design.errors import DesignError, GrowthError, NoRoomError, RootError, TissueError
from design.network import VesselNetwork
from design.tissue import Tissue
from design.vasculature.growth.regions import LargeGrowth, suits_regions
from design.vasculature.growth.root import deep_roots, search_root
from design.vasculature.growth.territories import Surroundings
from design.vasculature.growth.tree import ROUNDS, TreeGrowth
from design.vasculature.growth.trunk import Trunk, trunk_of
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree

__all__ = ["ATTEMPTS", "ROUNDS", "SPREADS", "TRIED_AT_MOST", "TreeGrowth", "grow_tree"]

SPREADS = (1.7, 1.5, 1.6, 1.4, 1.3)
"""Terminal spreads tried in turn where none is given: wide ones leave the terminals free, narrow
ones keep the trunk thin. One whose trunk was too wide for half of the terminals isn't tried
again, nor a wider one."""

ATTEMPTS = 24
"""Growths from other random numbers, where one gets stuck and nothing else is said."""

DEEP_ROOTS = 3
"""Deep places tried where the default root is too shallow, or its tree gets stuck."""

PROBES = 3
"""Growths from a deep place after the default root's tree got stuck, and of each of the small
trees by which a root is searched for."""

TRIED_AT_MOST = 2_000_000
"""Points tried in failed attempts, after which no third or later one is begun."""


def grow_tree(
    tissue: Tissue,
    options: GrowthOptions,
    *,
    attempts: int = ATTEMPTS,
    trunk: VesselNetwork | VesselTree | None = None,
    pool: Executor | None = None,
) -> VesselTree:
    """Grow a tree that stays in the tissue and doesn't collide.

    Without a root of the user's the tree enters at the highest vertex. Where no trunk fits there,
    or the tree gets stuck before half of its terminals, it enters where the tissue is deep; its
    notes say so.

    Points are sampled in the tissue by its demand, or given. Each joins the tree at the segment
    and place that cost least (Schreiner & Buxbaum 1993; exact over the whole tree), among those
    whose vessels fit with the radii that the finished tree is predicted to have. At the end all
    pairs are audited with the true radii; what doesn't fit is pruned and grown elsewhere.

    Parameters
    ----------
    tissue : Tissue
    options : GrowthOptions
    attempts : int
        Growths from other random numbers at most, where one gets stuck.
    trunk : VesselNetwork or VesselTree, optional
        Growth goes on from it (`growth.trunk`): its segments stay, its radii follow
        from what they then feed. Its ends count as terminals, unless the terminals are given.
    pool : concurrent.futures.Executor, optional
        Who grows the regions of a large tree (`growth.regions`): processes, or a Dask cluster
        (`ClusterPool`). By default threads, as many as numba may use. The tree is the same by any.

    Returns
    -------
    VesselTree
        Same tissue, options and seed: the same bytes. Its notes say where a root searched for
        was found, and what became of a trunk.

    Raises
    ------
    TissueError
        When the tissue is too thin for the root's branches.
    GrowthError
        When the root is misplaced, no more terminals fit (with how many did), given terminals
        can't be reached (with which), or repair fails (with how many vessels are left that don't
        fit).
    """
    stem = None if trunk is None else trunk_of(trunk)
    if not options.root_candidates:
        try:
            return grow_from_root(tissue, options, attempts, stem, pool)
        except (RootError, NoRoomError) as error:
            half_placed = 2 * _placed(error) >= options.terminals
            if stem is not None or options.root_point_mm is not None or half_placed:
                raise
            return _grow_from_deep_root(tissue, options, attempts, error, pool)
    if stem is not None:
        raise GrowthError("a trunk has a root of its own; set root_candidates to 0")
    root = search_root(tissue, options, _probed)
    point, way = root.points[root.best].tolist(), root.directions[root.best].tolist()
    placed = replace(
        options, root_candidates=0, root_point_mm=tuple(point), root_direction=tuple(way)
    )
    tree = grow_from_root(tissue, placed, attempts, None, pool)
    return replace(tree, notes=(root.note, *tree.notes))


def _grow_from_deep_root(
    tissue: Tissue,
    options: GrowthOptions,
    attempts: int,
    why: RootError | NoRoomError,
    pool: Executor | None,
) -> VesselTree:
    """Grow from where the tissue is deep, after the default root failed by ``why``.

    Raises
    ------
    RootError, NoRoomError
        When none of the places holds the tree: of the root that placed most terminals.
    """
    trouble = "no trunk fits at the highest point"
    if isinstance(why, NoRoomError):
        attempts = min(attempts, PROBES)
        trouble = f"from the highest point only {why.placed} terminals fit"
    for point, way in zip(*deep_roots(tissue, DEEP_ROOTS, options.seed), strict=True):
        x, y, z = point.tolist()
        dx, dy, dz = way.tolist()
        placed = replace(options, root_point_mm=(x, y, z), root_direction=(dx, dy, dz))
        try:
            tree = grow_from_root(tissue, placed, attempts, None, pool)
        except (RootError, NoRoomError) as error:
            why = max(why, error, key=_placed)
            continue
        note = (
            f"{trouble}, so the root was put at ({x:.4g}, {y:.4g}, {z:.4g}) mm, where the tissue "
            "is deep"
        )
        return replace(tree, notes=(note, *tree.notes))
    raise why


def _placed(error: RootError | NoRoomError) -> int:
    """Return the number of terminals that found a place."""
    return error.placed if isinstance(error, NoRoomError) else 0


def _probed(tissue: Tissue, options: GrowthOptions) -> VesselTree:
    """A small tree, to see what a root costs."""
    return grow_from_root(tissue, options, PROBES, None)


def grow_from_root(
    tissue: Tissue,
    options: GrowthOptions,
    attempts: int,
    trunk: Trunk | None,
    pool: Executor | None = None,
) -> VesselTree:
    """The first attempt that succeeds from the root as it is given, or from the highest point.

    Raises
    ------
    TissueError, GrowthError
        As `grow_tree`, but no other root is tried: `RootError` where none of the attempts found
        room for a trunk.
    """
    spreads = [options.terminal_spread] if options.terminal_spread else list(SPREADS)
    tried, most = 0, -1
    best: DesignError = GrowthError("not tried")
    for attempt in range(attempts):
        spread = spreads[attempt % len(spreads)]
        kind = LargeGrowth if suits_regions(options, trunk) else TreeGrowth
        growth = kind.open(tissue, options, Surroundings(), spread, attempt, trunk)
        if isinstance(growth, LargeGrowth):
            growth.pool = pool
        try:
            return growth.run()
        except (GrowthError, TissueError) as error:
            grown = growth.terminals
            if grown > most:
                most, best = grown, error
        if grown < options.terminals // 2:
            spreads = [s for s in spreads if s < spread] or spreads
        tried += int(growth.progress["tried"][0])
        if attempt > 0 and tried > TRIED_AT_MOST:
            break
    raise best.around(after=f" (best of {attempt + 1} attempts)") from best
