"""Grow one tree: add terminals, audit with the final radii, repair; retry from other roots."""

from __future__ import annotations

from concurrent.futures import Executor, Future
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from design.errors import (
    DesignError,
    GrowthError,
    NoRoomError,
    RootError,
    TissueError,
    TrunkWallError,
)
from design.network import VesselNetwork
from design.tissue import Tissue
from design.vasculature.growth.kernels.allowed_radius import measure_allowed_radii, measure_changed
from design.vasculature.growth.kernels.cost import (
    SEGMENT,
    TRUNK,
    Segments,
    depth_first,
    place,
    refresh,
    refresh_all,
    settle_radii,
)
from design.vasculature.growth.kernels.index import (
    LISTING,
    RESERVE,
    CellIndex,
    Clearances,
    clear_of,
    clearances_of,
    empty_index,
    index_segments,
)
from design.vasculature.growth.kernels.kernel import (
    DONE,
    FULL_INDEX,
    MORE_POINTS,
    PROGRESS,
    REBUILD,
    Scale,
    derive_radii,
    first_pair,
    grow,
)
from design.vasculature.growth.kernels.new_ends import retip_thin
from design.vasculature.growth.kernels.points import (
    MIN_TERMINAL_FLOW,
    SAMPLING,
    GivenPoints,
    Sampler,
    Samples,
    obstructing_segments,
    out_of_room,
)
from design.vasculature.growth.kernels.prune import prune
from design.vasculature.growth.kernels.search_settings import RADII, SEARCH, SPACING
from design.vasculature.growth.region_split import REGIONS, split_tree
from design.vasculature.growth.regions import (
    Region,
    grow_regions,
    measure_again,
    measure_in_parallel,
    terminals_before_split,
)
from design.vasculature.growth.root import (
    check_trunk_wall,
    default_root_note,
    has_default_root,
    lengthen_stem,
    rooted_at,
    sole_end,
    stem,
    stem_is_short,
)
from design.vasculature.growth.root_search import grow_from_deep_root, search_root
from design.vasculature.growth.supply import flows_by_demand
from design.vasculature.growth.territories import Surroundings
from design.vasculature.growth.threads import thread_count
from design.vasculature.growth.trunk import NARROW_PART, Trunk, trunk_of
from design.vasculature.options import GrowthOptions
from design.vasculature.penalty import PenaltyArrays, sample_penalty
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import scaled_to_smallest_radius, tree_from_topology
from kernels.arrays import FloatArray

SPREADS = (1.7, 1.5, 1.6, 1.4, 1.3)
"""Terminal spreads tried in turn where none is given: wide ones leave the terminals free, narrow
ones keep the trunk thin. One whose trunk was too wide for half of the terminals isn't tried
again, nor a wider one."""


class Effort(NamedTuple):
    """How long growth tries before it gives up."""

    attempts: int = 24
    """Growths from other random numbers, where one gets stuck."""
    deep_roots: int = 3
    """Deep places tried where the default root is too shallow, or its tree gets stuck."""
    probes: int = 3
    """Growths from each of these, and of each small tree by which a root is searched for."""
    tried_points: int = 2_000_000
    """Points tried in failed attempts, after which no third or later one is begun."""
    audits: int = 20
    """Audits and repairs of a grown tree."""
    failed_points: int = 20_000
    """Points in a row that find no place."""
    clearings: int = 40
    """Removals of what obstructs given points."""


EFFORT = Effort()


def grow_tree(
    tissue: Tissue,
    options: GrowthOptions,
    *,
    attempts: int = EFFORT.attempts,
    trunk: VesselNetwork | VesselTree | None = None,
    pool: Executor | None = None,
) -> VesselTree:
    """Grow a tree that stays in the tissue and doesn't collide.

    Without a root of the user's the tree enters inside a face, on top where there is one with room
    for the trunk. Where no trunk fits, or the tree gets stuck before half of its terminals, it
    enters where the tissue is deep; its notes say where.

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
            half_placed = 2 * error.placed >= options.terminals
            if stem is not None or options.root_point_mm is not None or half_placed:
                raise
            # From elsewhere a tree that got stuck once gets few more attempts.
            few = min(attempts, EFFORT.probes) if isinstance(error, NoRoomError) else attempts
            return grow_from_deep_root(
                tissue,
                options,
                EFFORT.deep_roots,
                error,
                partial(grow_from_root, attempts=few, pool=pool),
                _mouth_reach(tissue, options),
            )
    if stem is not None:
        raise GrowthError("a trunk has a root of its own; set root_candidates to 0")
    placed, note = place_root(tissue, options)
    tree = grow_from_root(tissue, placed, attempts, None, pool)
    return replace(tree, notes=(note, *tree.notes))


def place_root(tissue: Tissue, options: GrowthOptions) -> tuple[GrowthOptions, str]:
    """Search a root for one tree; return the options with it, and a sentence on the search.

    Raises
    ------
    GrowthError
        As `search_root`.
    """
    root = search_root(
        tissue,
        options,
        partial(grow_from_root, attempts=EFFORT.probes),
        _mouth_reach(tissue, options),
    )
    return rooted_at(options, root.points[root.best], root.directions[root.best]), root.note


def _mouth_reach(tissue: Tissue, options: GrowthOptions) -> float:
    """Radius of the narrowest trunk that is tried, and its wall, mm."""
    spread = options.terminal_spread or min(SPREADS)
    scale = Scale.of(options, tissue.volume_mm3, options.terminals, spread)
    return scale.first_radius(options.law, tissue.volume_mm3) + options.clearance_mm


def grow_from_root(
    tissue: Tissue,
    options: GrowthOptions,
    attempts: int,
    trunk: Trunk | None = None,
    pool: Executor | None = None,
) -> VesselTree:
    """The first attempt that succeeds from the root as it is given, or from inside a face.

    A trunk that turns out too wide for its place gets one with more room the next time.

    Raises
    ------
    TissueError, GrowthError
        As `grow_tree`, but no other root is tried: `RootError` where none of the attempts found
        room for a trunk.
    """
    spreads = [options.terminal_spread] if options.terminal_spread else list(SPREADS)
    split_at = terminals_before_split(options, trunk)
    tried, most = 0, -1
    best: DesignError = GrowthError("not tried")
    reserved = 0.0
    for attempt in range(attempts):
        spread = spreads[attempt % len(spreads)]
        growth = TreeGrowth.open(
            tissue, options, Surroundings(), spread, attempt, trunk, split_at=split_at, pool=pool
        )
        growth.reserved_radius = reserved
        try:
            tree = growth.run()
            if trunk is None and has_default_root(options):
                note = default_root_note(tree.proximal[0], tree.distal[0])
                tree = replace(tree, notes=(note, *tree.notes))
            return tree
        except (GrowthError, TissueError) as error:
            if isinstance(error, TrunkWallError) and growth.scale.root_radius == 0:
                reserved = max(reserved, error.radius_mm)
            grown = growth.terminals
            if grown > most:
                most, best = grown, error
        if grown < options.terminals // 2:
            spreads = [s for s in spreads if s < spread] or spreads
        tried += int(growth.progress["tried"][0])
        if attempt > 0 and tried > EFFORT.tried_points:
            break
    raise best.around(after=f" (best of {attempt + 1} attempts)") from best


@dataclass
class TreeGrowth:
    """State and loop of one tree's growth: terminals are added, audited and repaired.

    A large tree is divided into regions at ``split_at`` terminals. Each region is grown by a growth
    of its own (`grow_region`), on any thread, process or machine.

    Attributes
    ----------
    tissue, options, others, scale
        What the tree depends on; ``others`` are vessels that it keeps clear of.
    segments : Segments
        Its own, room for those to come, and behind all the vessels of others.
    random : Generator
    trunk : Trunk, optional
    given : GivenPoints, optional
    split_at : int
        Terminals at which the tree is divided into regions; 0 where it isn't (any more).
    pool : Executor, optional
        Who grows the regions; threads of this process, one a core, by default.
    region : Region, optional
        The part of a large tree that this growth is of.
    reserved_radius : float, mm
        Of the trunk's place at least: as wide as it became in a growth before.
    clearances, index, sampler, penalty, progress
        As kernels take them.
    """

    tissue: Tissue
    options: GrowthOptions
    others: Surroundings
    scale: Scale
    segments: Segments
    random: np.random.Generator
    trunk: Trunk | None = None
    given: GivenPoints | None = None
    split_at: int = 0
    pool: Executor | None = None
    region: Region | None = None
    reserved_radius: float = 0.0
    clearances: Clearances = field(init=False)
    index: CellIndex = field(init=False)
    sampler: Sampler = field(init=False)
    penalty: PenaltyArrays = field(init=False)
    progress: NDArray[np.void] = field(init=False)
    _by_regions: bool = field(init=False)
    _is_audited: bool = False
    _indexed: int = 0
    _stage: int = -1
    _unreached: int = -1
    _narrow_until: int = 0
    _sync_at: int = 0

    def __post_init__(self) -> None:
        tissue, options, trunk = self.tissue, self.options, self.trunk
        self._by_regions = self.split_at > 0
        self.clearances = clearances_of(tissue, options)
        self.index = empty_index(tissue.bounds, float(np.ptp(tissue.bounds)), 1, 1)
        self.sampler = Sampler.by(tissue, options, self.others.owns)
        nearest = SEARCH.nearest
        if self.region is not None:
            nearest = REGIONS.nearest
            self.sampler = replace(
                self.sampler, corners=self.region.corners, edge_mm=self.region.edge_mm
            )
        self.penalty = sample_penalty(tissue, options.penalty)
        self.progress = np.zeros(1, PROGRESS)
        self.progress["min_spacing_factor"] = SPACING.most
        self.progress["relative_viscosity"] = 1.0
        self.progress["candidates"] = SEARCH.many_nearest if options.flow_ratio else nearest
        if trunk is not None and trunk.widest_branch < np.inf:
            self._narrow_until = round(NARROW_PART * self.goal)

    @classmethod
    def open(
        cls,
        tissue: Tissue,
        options: GrowthOptions,
        others: Surroundings,
        spread: float,
        attempt: int,
        trunk: Trunk | None = None,
        *,
        split_at: int = 0,
        pool: Executor | None = None,
    ) -> Self:
        """Return a growth with nothing in it yet; same arguments, same growth."""
        if options.root_candidates:
            raise GrowthError(
                "a root is searched for a tree alone (place_root, grow_tree); give each of several "
                "trees its root point"
            )
        given = GivenPoints.of(tissue, options)
        goal = options.terminals + (trunk.tips if given is not None and trunk is not None else 0)
        if trunk is not None:
            trunk.check(goal, options, tissue)
        size = 2 * (split_at or goal) + 1 + (len(trunk.parent) if trunk else 0)
        own = np.zeros(size, SEGMENT)
        # The stem and its first two; all others get theirs when they are made. Memory that isn't
        # written isn't taken.
        own["flow"][:3] = own["relative_viscosity"][:3] = 1.0
        return cls(
            tissue,
            options,
            others,
            Scale.of(options, others.share * tissue.volume_mm3, goal, spread),
            np.concatenate([own, others.records()]) if others.count else own,
            np.random.default_rng([options.seed, attempt]),
            trunk,
            given,
            split_at,
            pool,
        )

    @property
    def count(self) -> int:
        """Segments grown."""
        return int(self.progress["count"][0])

    @property
    def goal(self) -> int:
        """Terminals of the finished tree; with given points, a trunk's own besides."""
        return self.scale.goal

    @property
    def terminals(self) -> int:
        """Terminals grown."""
        return int(self.progress["terminals"][0])

    @property
    def _first_radius(self) -> float:
        first = self.scale.first_radius(self.options.law, self.tissue.volume_mm3)
        return max(first, self.reserved_radius)

    def meet(self, others: Surroundings) -> None:
        """Take the vessels of others as they are now."""
        own = self.segments[: len(self.segments) - self.others.count]
        self.others, self.segments = others, np.concatenate([own, others.records()])

    def run(self) -> VesselTree:
        """Grow, audit and repair until everything fits."""
        self.start()
        for _ in range(EFFORT.audits):
            self.grow()
            left = self.audit()
            if left == 0:
                return self.tree()
            self.repair()
        raise GrowthError(
            f"{left} of {self.count} vessels still collide or leave the tissue after "
            f"{EFFORT.audits} repairs; ask for fewer terminals, a smaller smallest_diameter_mm or "
            "clearance_mm"
        )

    def start(self) -> None:
        """Plant the trunk, or place the stem and the first two terminals."""
        law = self.options.law
        if self.trunk is not None:
            self.trunk.plant(self.segments, law)
            self.progress["count"] = len(self.trunk.parent)
            self.progress["terminals"] = self.trunk.tips
            derive_radii(self.segments, self.progress, law, self.scale)
            return
        settings = self._enter_stage()
        begin, end = stem(self.tissue, settings, self._first_radius, self.clearances.wall)
        self.segments[0]["parent"] = self.segments[0]["left"] = self.segments[0]["right"] = -1
        place(self.segments, 0, tuple(begin), tuple(end))
        refresh(self.segments, 0, law)
        self.segments[0]["allowed"] = np.inf
        if self.others.count and not self._clear(begin, end[None], self._first_radius)[0]:
            raise GrowthError(
                "the root's stem from ({:.4g}, {:.4g}, {:.4g}) ".format(*begin)
                + "meets another tree's vessel; choose another place or direction of the root"
            )
        self.progress["count"], self.progress["terminals"] = 1, 1
        if self.options.terminals > 1:
            self._first_pair()
        else:
            end = self._sole_end(begin, end)
            place(self.segments, 0, tuple(begin), tuple(end))
            refresh(self.segments, 0, law)
        derive_radii(self.segments, self.progress, law, self.scale)

    def _sole_end(self, begin: FloatArray, end: FloatArray) -> FloatArray:
        """Where the one terminal ends: as given, else in the middle of what it supplies.

        A root direction that is given is kept.
        """
        radius = self._first_radius
        samples = self._samples(SAMPLING.min_points).at
        middle = samples.mean(axis=0) if len(samples) else end
        if self.given is not None:
            ends = samples
        elif self.options.root_direction is not None:
            across = float(np.linalg.norm(np.ptp(self.tissue.bounds, axis=0)))
            far = max(1.0, across / float(np.linalg.norm(end - begin)))
            ends = begin + np.linspace(1.0, far, SAMPLING.min_points)[:, None] * (end - begin)
        else:
            ends = np.concatenate([samples, end[None]])
        if self.others.count:
            ends = ends[self._clear(begin, ends, radius)]
        return sole_end(self.tissue, begin, ends, middle, radius + self.clearances.wall)

    def _first_pair(self) -> None:
        law, root = self.options.law, self._first_radius
        separation = 0.5 * float(np.cbrt(self.scale.volume))
        at = np.array([self.segments[name][0] for name in ("dx", "dy", "dz")])
        for _ in range(40):
            samples = self._samples(SAMPLING.min_points)
            if self.others.count:
                clear = self._clear(at, samples.at, root)
                samples = Samples(*(column[clear] for column in samples))
            if first_pair(self.segments, self.clearances, law, root, samples, separation):
                self.progress["count"], self.progress["terminals"] = 3, 2
                self.segments["allowed"][:3] = np.inf
                return
            separation *= 0.85
        raise RootError(
            "no two branches fit at the end of the root's stem; choose another place or "
            "direction of the root, fewer terminals, a smaller smallest_diameter_mm or clearance_mm"
        )

    def _clear(self, begin: Any, points: Any, radius: float) -> Any:
        """Whether capsules from ``begin`` to each of ``points`` clear the vessels of others."""
        self._reindex(own=0)
        return clear_of(self.segments, self.index, self.clearances, begin, points, radius)

    def _enter_stage(self) -> GrowthOptions:
        """Take the parameters of the stage that growth is in, and return them."""
        stages, settings, now = self.options.stages, self.options, -1
        if stages:
            ends = [stage.terminals for stage in stages[:-1]]
            now = int(np.searchsorted(ends, self.terminals, side="right"))
            settings = self.options.at_stage(stages[now])
        self.clearances = clearances_of(self.tissue, settings)
        if now != self._stage:
            self._stage = now
            self.sampler = Sampler.by(self.tissue, settings, self.others.owns)
            self.penalty = sample_penalty(self.tissue, settings.penalty)
        return settings

    def grow(self, until: int | None = None) -> None:
        """Grow up to the goal, wherever growth stands, or to so many terminals on the way."""
        if self.split_at:
            self.grow_to(self.split_at)
            self._grow_regions()
        goal = min(until or self.goal, self.goal)
        while self.terminals < goal:
            self._enter_stage()
            stages = self.options.stages
            self.grow_to(min(goal, stages[self._stage].terminals) if stages else goal)

    def _grow_regions(self) -> None:
        """Divide the tree into regions and grow each; what they fall short of grows later."""
        law = self.options.law
        derive_radii(self.segments, self.progress, law, self.scale)
        early = depth_first(self.segments, self.count)[: self.count]
        seed = int(self.random.integers(1 << 62))
        split = split_tree(early, self.tissue, self.goal, self.sampler.dense, seed)

        def submit(pool: Executor, region: Region) -> Future[Any]:
            return pool.submit(grow_region, self.tissue, self.options, self.scale, region, seed)

        self.segments, count = grow_regions(split, self.options.clearance_mm, self.pool, submit)
        self.split_at = 0
        refresh_all(self.segments, count, law)
        self.progress["count"], self.progress["terminals"] = count, self.segments["terminals"][0]
        derive_radii(self.segments, self.progress, law, self.scale)

    def grow_to(self, goal: int) -> None:
        """Grow to so many terminals with the parameters of now."""
        self.progress["since"] = 0
        samples, first = self.sampler.none(), 0
        status = FULL_INDEX
        while status != DONE and self.terminals < goal:
            if status == MORE_POINTS:
                samples, first = self._more(), 0
            else:
                self._pause(status)
            status, first = grow(
                self.segments,
                self.index,
                self.clearances._replace(
                    reserve=self._reserve(), widest_branch=self._widest_branch()
                ),
                self.options.law,
                self.scale,
                self.penalty,
                self.progress,
                samples,
                first,
                min(self._pause_at(), goal),
            )
            # Points in the order of a curve fail together: a whole lot of them must.
            stuck = self.progress["since"][0] > max(EFFORT.failed_points, len(samples.at))
            if stuck and self.terminals < self._narrow_until:
                self._narrow_until, status = 0, FULL_INDEX
                self.progress["since"] = 0
            elif stuck and self.given is None:
                reached = self.terminals, self.trunk.tips if self.trunk else 0
                root = self.scale.root_radius
                failed = EFFORT.failed_points
                raise out_of_room(self.options, self.clearances, reached, self.goal, root, failed)

    def _pause_at(self) -> int:
        """Terminals at which growth pauses, unless the index is full before."""
        at = 2 * self._indexed
        if self.terminals < self._narrow_until:
            at = min(at, self._narrow_until)
        return at if self.region is None else min(at, self._sync_at)

    def _pause(self, status: int) -> None:
        """Do what is due before growth goes on."""
        if self.region is not None:
            self.region.grow_elsewhere(self.segments, self.terminals, self.options.law)
            self._sync_at = self.terminals + max(1, self.terminals // REGIONS.sync_divisor)
            if status == REBUILD and self.terminals < 2 * self._indexed:
                derive_radii(self.segments, self.progress, self.options.law, self.scale)
                return
        self._relist()

    def _relist(self) -> None:
        """List everything anew, and measure how wide each segment may be."""
        self._reindex()
        self._measure()
        derive_radii(self.segments, self.progress, self.options.law, self.scale)

    def _reindex(self, own: int | None = None) -> None:
        """List everything anew, in cells that suit the tree until it has doubled.

        Of the tree's own segments ``own`` are listed, or all.
        """
        region = self.region
        if region is None:
            self._indexed, others = max(4, self.terminals), self.others.count
            # Numbered by branch where the cache asks for it; grown by regions, it is so already.
            is_grown_by_regions = self._by_regions and not self.split_at
            if self.terminals > SAMPLING.ordered_from and not is_grown_by_regions:
                self.segments = depth_first(self.segments, self.count)
            bounds = self.tissue.bounds
        else:
            self._indexed, others = self.terminals, len(region.around)
            grown = self.segments[len(region.frozen) : self.count]
            bounds = np.stack(region.box(grown, self.clearances.clearance))
        goal = min(self.goal, 2 * self.terminals)
        cell = LISTING.cell_factor * float(np.cbrt(self.scale.volume / max(8, goal)))
        count = self.count if own is None else own
        self.index = index_segments(bounds, cell, self.segments, count, others, self.clearances)

    def _measure(self) -> None:
        """Measure how wide each segment may be, as far as it may have changed."""
        if self.region is not None and self.terminals > self.region.terminals:
            # What is new has measured itself and its neighbours, and shares change little.
            return
        # By the limits of the audit: those that a later stage sets for its own joints would close
        # the earlier ones'.
        clearances = clearances_of(self.tissue, self.options.mildest())
        clearances = clearances._replace(widest_branch=self._widest_branch())
        if self.progress["check_each_terminal"][0]:
            # The audit has measured all but what was pruned since.
            measure_changed(self.segments, self.count, self.index, clearances, 0.0, True)
        else:
            # Neighbours' shares have changed since each segment was measured.
            measure_allowed_radii(self.segments, self.count, self.index, clearances, 0.0, False)

    def _samples(self, tries: int) -> Samples:
        """Points to grow to: so many tries at new ones, or the given ones that are left."""
        if self.given is not None:
            return self.given.samples(self.random.permutation(self._missing(self.given)))
        return self.sampler.draw(self.random, tries, self.terminals > SAMPLING.ordered_from)

    def _missing(self, given: GivenPoints) -> NDArray[np.int64]:
        """Given points that aren't reached."""
        s = self.segments[: self.count]
        tips = s[(s["left"] < 0) & (s["given"] == 0)]
        return given.missing(np.column_stack([tips["dx"], tips["dy"], tips["dz"]]))

    def _more(self) -> Samples:
        """More points to grow to."""
        if self.given is None:
            return self._samples(self._tries())
        missing = self._missing(self.given)
        if len(missing) == self._unreached:
            # A whole pass reached none of them.
            return self._made_way(self.given, missing)
        self._unreached = len(missing)
        return self.given.samples(self.random.permutation(missing))

    def _tries(self) -> int:
        """Return how many points to draw at a time."""
        per_wanted = self.sampler.volume_mm3 / (self.scale.volume * self.sampler.kept)
        tries = SAMPLING.per_terminal * per_wanted * self.terminals
        # A region's points come in order, so that more would make another tree: 2 % more volume.
        return (
            int(tries) + 1
            if self.region is not None
            else int(np.clip(tries, SAMPLING.min_points, 1 << 21))
        )

    def _made_way(self, given: GivenPoints, missing: NDArray[np.int64]) -> Samples:
        """Take away what lies nearest to points that can't be reached, and put these first."""
        passes = given.stuck_on(missing)
        self.progress["candidates"] = SEARCH.many_nearest
        if passes > EFFORT.clearings:
            raise given.unreached(missing, self.tissue)
        s = self.segments[: self.count]
        s["allowed"] = np.inf
        s["allowed"][obstructing_segments(s, given.at[missing], 1 + passes // 5)] = 0.0
        self._reindex()
        try:
            self._prune()
        except GrowthError as error:
            raise given.unreached(missing, self.tissue) from error
        self._relist()
        freed = np.setdiff1d(self._missing(given), missing)
        self._unreached = len(missing) + len(freed)
        order = [self.random.permutation(some) for some in (missing, freed)]
        return given.samples(np.concatenate(order))

    def _widest_branch(self) -> float:
        """Radius, over the root's, at which a branch takes on no more terminals now."""
        early = self.terminals < self._narrow_until
        return self.trunk.widest_branch if self.trunk is not None and early else np.inf

    def _reserve(self) -> float:
        """How much wider than predicted trial forks must be able to grow."""
        if self.scale.root_radius > 0:
            return RESERVE.least
        left = float(np.log(self.goal / self.terminals))
        return min(RESERVE.least + RESERVE.per_e_fold * left, RESERVE.most)

    def audit(self) -> int:
        """Derive the final radii; return how many segments don't fit with them.

        With a smallest radius, a thinner terminal doesn't fit either; nor does a stem too short
        for its radius, nor a joint that breaks the limits.
        """
        self.clearances = clearances_of(self.tissue, self.options.mildest())
        if self.sampler.flows:
            self._share_by_demand()
        settle_radii(
            self.segments,
            self.count,
            self.options.law,
            self.scale.root_radius,
            self.scale.flow_over_drop,
            self.options.smallest_radius_mm,
        )
        self._check_trunk()
        self._reindex()
        # What meets the smallest radius to rounding passes.
        least = (self.options.smallest_radius_mm or 0.0) * (1.0 - 1e-9)
        return self._too_wide(least) + self._stem_is_short()

    def _check_trunk(self) -> None:
        """Refuse a stem whose final radius leaves its wall too thin."""
        if self.trunk is not None or self.options.root_at_top or self._stem_is_short():
            return
        s = self.segments[0]
        begin, end = np.array([s["px"], s["py"], s["pz"]]), np.array([s["dx"], s["dy"], s["dz"]])
        radius = float(s["radius"])
        check_trunk_wall(self.tissue, begin, end, radius, self.clearances.wall)

    def _too_wide(self, least: float) -> int:
        """Return how many segments the final audit finds wider than allowed."""
        known = self.segments, self.count, self.index, self.clearances, least
        if not self._by_regions:
            return int(measure_allowed_radii(*known, True))
        if self._is_audited:
            return measure_again(*known)
        self._is_audited = True
        return measure_in_parallel(*known, thread_count())

    def _share_by_demand(self) -> None:
        """Give each terminal the flow that its territory asks for."""
        s = self.segments[: self.count]
        tips = np.flatnonzero(s["left"] < 0)
        at = np.column_stack([s["dx"], s["dy"], s["dz"]])[tips]
        terminals, seed = self.options.terminals, self.options.seed
        share = flows_by_demand(self.tissue, at, terminals, seed, self.others.owns)
        s["flow"][tips] = np.maximum(share, MIN_TERMINAL_FLOW)
        refresh_all(self.segments, self.count, self.options.law)

    def _stem_is_short(self) -> bool:
        return self.trunk is None and stem_is_short(self.segments, self.clearances)

    def repair(self) -> None:
        """Lengthen the stem, or move tips that are too thin and take away what else doesn't fit."""
        self.progress["check_each_terminal"] = 1
        if self._stem_is_short():
            self._is_audited = False
            lengthen_stem(self.segments, self.clearances, self.options.law)
            return
        if self.options.smallest_radius_mm is not None and self.given is None:
            retip_thin(
                self.segments,
                self.count,
                self.index,
                self.clearances,
                self.options.law,
                self._samples(SAMPLING.min_points).at,
                RADII.thin_margin * self.options.smallest_radius_mm,
            )
        self._prune()

    def _prune(self) -> None:
        """Take away what is wider than allowed."""
        least = RADII.thin_margin * (self.options.smallest_radius_mm or 0.0)
        if self.given is not None:
            least = np.inf  # a given terminal stays where it is
        law = self.options.law
        left = prune(self.segments, self.count, self.index, self.clearances, law, least)
        if left == 1 and self.trunk is None:
            raise RootError(
                "the branches at the root don't fit with their final radii; choose another "
                "place of the root, fewer terminals, a smaller smallest_diameter_mm or clearance_mm"
            )
        self.progress["count"] = left
        self.progress["terminals"] = self.segments["terminals"][0]
        self.progress["min_spacing_factor"] = SPACING.most
        derive_radii(self.segments, self.progress, self.options.law, self.scale)

    def tree(self) -> VesselTree:
        """Return the finished tree, its ratios computed afresh; the growth's arrays are let go."""
        options, trunk, smallest = self.options, self.trunk, self.options.smallest_radius_mm
        self.index = empty_index(self.tissue.bounds, 1e9, 1, 1)
        s = self.segments[: self.count]
        flow, drop = options.flow_ul_s(self.scale.volume), options.pressure_drop_pa
        if smallest:
            names = "weighted_resistance", "flow", "radius"
            resistance, root_flow, root_radius = (float(s[name][0]) for name in names)
            drop = flow * resistance / (root_flow * root_radius**4)
        notes = () if trunk is None else (trunk.note(s, self.tissue),)
        equal = options.terminal_flow == "equal" and options.terminal_flows is None
        arrays = (
            np.column_stack([s["px"], s["py"], s["pz"]]),
            np.column_stack([s["dx"], s["dy"], s["dz"]]),
            s["parent"].copy(),
            np.column_stack([s["left"], s["right"]]),
        )
        relative_flow = None if equal and trunk is None else s["flow"].copy()
        given = s["given"] == TRUNK
        del s
        self.segments = self.segments[:0].copy()
        tree = tree_from_topology(
            *arrays,
            flow_ul_s=flow,
            pressure_drop_pa=drop,
            murray_exponent=options.murray_exponent,
            viscosity_pa_s=options.viscosity_pa_s,
            relative_flow=relative_flow,
            haematocrit=options.law_haematocrit,
            given=given,
        )
        tree = scaled_to_smallest_radius(tree, smallest) if smallest else tree
        return replace(tree, notes=notes) if notes else tree


def grow_region(
    tissue: Tissue, options: GrowthOptions, scale: Scale, region: Region, seed: int
) -> Segments:
    """Grow a region as far as there is room.

    ``scale`` is that of the whole tree. Returns the region's segments, numbered on from those that
    hold it.
    """
    frozen, share = len(region.frozen), region.goal / scale.goal
    to_come = np.zeros(2 * (region.goal - region.terminals), SEGMENT)
    growth = TreeGrowth(
        tissue,
        options,
        Surroundings(),
        scale._replace(goal=region.goal, volume=share * scale.volume, share=share),
        np.concatenate([region.segments, to_come, region.around]),
        np.random.default_rng([seed, region.number]),
        region=region,
    )
    growth.progress["count"], growth.progress["terminals"] = len(region.segments), region.terminals
    growth.progress["frozen_count"] = frozen
    # Out of room: what is missing grows elsewhere, or that says so.
    with suppress(GrowthError):
        growth.grow_to(region.goal)
    return growth.segments[frozen : growth.count].copy()
