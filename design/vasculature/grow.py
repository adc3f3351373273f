"""Grow a tree in a tissue by constrained constructive optimisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.errors import DesignError, GrowthError, TissueError
from design.tissue import Tissue
from design.vasculature.audit import measure_room, prune
from design.vasculature.index import CellIndex, empty_index
from design.vasculature.options import GrowthOptions
from design.vasculature.retip import retip_thin
from design.vasculature.room import MARGIN, MARGIN_AT_MOST, MARGIN_LEFT, Room
from design.vasculature.root import lengthen_stem, stem, stem_is_short
from design.vasculature.sample import depth_first, inside
from design.vasculature.start import first_pair
from design.vasculature.state import SEGMENT, place, refresh, spread_down
from design.vasculature.step import (
    DONE,
    FULL_INDEX,
    MORE_POINTS,
    PROGRESS,
    THIN_MARGIN,
    Scale,
    derive_radii,
    grow,
    list_all,
    list_from,
)
from design.vasculature.surroundings import Surroundings, clear_of
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import scaled_to_smallest_radius, tree_from_topology

SPREADS = (1.7, 1.5, 1.6, 1.4, 1.3)
"""Terminal spreads tried in turn where none is given: wide ones leave the terminals free, narrow
ones keep the trunk thin. One whose trunk was too wide for half of the terminals isn't tried
again, nor a wider one."""

ATTEMPTS = 24
"""Growths from other random numbers, where one gets stuck and nothing else is said."""

TRIED_AT_MOST = 2_000_000
"""Points tried in failed attempts, after which no other is begun."""

ROUNDS = 20
"""Audits and repairs at most."""

_EAGER, _PATIENT = 6, 400
"""Patience (see `Scale`) of thin trees, which get everywhere at once, and of those with a smallest
radius: with that of the former, 95 % of a folded slab lay within 7.9 mm of a lumen, not 1.9."""

_PATIENCE = 20_000
_CHUNK = 4096
_CELL = 1.2
_TRIES = 0.5
"""Points in the tissue sampled at a time, over the terminals there are: few enough that a tree
grown to them in order is like one grown in random order."""
_SMALL = 10_000
"""Terminals below which a tree is in the cache, however it is ordered."""


def grow_tree(tissue: Tissue, options: GrowthOptions, *, attempts: int = ATTEMPTS) -> VesselTree:
    """Grow a tree of equal terminal flows that stays in the tissue and doesn't collide.

    Points are sampled uniformly in the tissue. Each joins the tree at the segment and place that
    cost least (Schreiner & Buxbaum 1993; exact over the whole tree), among those whose vessels fit
    with the radii that the finished tree is predicted to have. At the end all pairs are audited
    with the true radii; what doesn't fit is pruned and grown elsewhere.

    Parameters
    ----------
    tissue : Tissue
    options : GrowthOptions
    attempts : int
        Growths from other random numbers at most, where one gets stuck.

    Returns
    -------
    VesselTree
        Same tissue, options and seed: the same bytes.

    Raises
    ------
    TissueError
        When the tissue is too thin for the root's branches.
    GrowthError
        When the root is misplaced, no more terminals fit (with how many did), or repair fails
        (with how many vessels are left that don't fit).
    """
    spreads = [options.terminal_spread] if options.terminal_spread else list(SPREADS)
    tried, most = 0, -1
    best: DesignError = GrowthError("not tried")
    for attempt in range(attempts):
        spread = spreads[attempt % len(spreads)]
        garden = Garden.open(tissue, options, Surroundings(), spread, attempt)
        try:
            return garden.run()
        except (GrowthError, TissueError) as error:
            grown = garden.terminals
            if grown > most:
                most, best = grown, error
        if grown < options.terminals // 2:
            spreads = [s for s in spreads if s < spread] or spreads
        tried += int(garden.progress["tried"][0])
        if tried > TRIED_AT_MOST:
            break
    raise type(best)(f"{best} (best of {attempt + 1} attempts)") from best


def _just(value: float) -> float:
    """A hair below a value: what meets it to rounding passes."""
    return value * (1.0 - 1e-9)


@dataclass
class Garden:
    """The arrays of one growth, and the loop around its kernels."""

    tissue: Tissue
    options: GrowthOptions
    others: Surroundings
    room: Room
    scale: Scale
    segments: NDArray[np.void]
    progress: NDArray[np.void]
    random: np.random.Generator
    index: CellIndex
    indexed: int = 0

    @classmethod
    def open(
        cls,
        tissue: Tissue,
        options: GrowthOptions,
        others: Surroundings,
        spread: float,
        attempt: int,
    ) -> Garden:
        """A garden with nothing in it yet; same arguments, same growth."""
        grid = tissue.grid
        room = Room(
            grid.arrays,
            options.clearance_mm,
            options.clearance_mm,
            options.clearance_ratio,
            options.length_to_radius,
            MARGIN,
        )
        fixed = options.smallest_radius_mm or 0.0
        spread = spread if fixed else 0.0
        root = fixed * spread * options.terminals ** (1.0 / options.murray_exponent)
        volume = others.share * tissue.volume_mm3
        drop = options.flow_ul_s(volume) / options.pressure_drop_pa
        patience = _PATIENT if fixed else _EAGER
        scale = Scale(drop, root, spread, options.terminals, volume, patience)
        own = np.zeros(2 * options.terminals + 1, SEGMENT)
        segments = np.concatenate([own, others.records()]) if others.count else own
        progress = np.zeros(1, PROGRESS)
        progress["apart"] = 0.9
        index = empty_index(tissue.bounds, float(np.ptp(tissue.bounds)), 1, 1)
        random = np.random.default_rng([options.seed, attempt])
        return cls(tissue, options, others, room, scale, segments, progress, random, index)

    @property
    def count(self) -> int:
        """Segments grown."""
        return int(self.progress["count"][0])

    @property
    def terminals(self) -> int:
        """Terminals grown."""
        return int(self.progress["terminals"][0])

    def meet(self, others: Surroundings) -> None:
        """Take the vessels of others as they are now."""
        own = self.segments[: 2 * self.options.terminals + 1]
        self.others, self.segments = others, np.concatenate([own, others.records()])

    def run(self) -> VesselTree:
        """Grow, audit and repair until everything fits."""
        self.start()
        for _ in range(ROUNDS):
            self.grow()
            left = self.audit()
            if left == 0:
                return self.tree()
            self.repair()
        raise GrowthError(
            f"{left} of {self.count} vessels still collide or leave the tissue after {ROUNDS} "
            "repairs; ask for fewer terminals, a smaller smallest radius or clearance"
        )

    def start(self) -> None:
        """Place the stem and the first two terminals."""
        law, options = self.options.law, self.options
        begin, end = stem(self.tissue, options, self._first_guess(), self.room.wall)
        self.segments[0]["parent"] = self.segments[0]["left"] = self.segments[0]["right"] = -1
        place(self.segments, 0, tuple(begin), tuple(end))
        refresh(self.segments, 0, law)
        self.segments[0]["allowed"] = np.inf
        if self.others.count and not self._clear(begin, end[None], self._first_guess())[0]:
            raise GrowthError(
                "the root's stem from ({:.4g}, {:.4g}, {:.4g}) ".format(*begin)
                + "meets another tree's vessel; choose another root_point_mm or root_direction"
            )
        self.progress["count"], self.progress["terminals"] = 1, 1
        if options.terminals > 1:
            self._first_pair()
        derive_radii(self.segments, self.progress, law, self.scale)

    def _first_pair(self) -> None:
        law, root = self.options.law, self._first_guess()
        apart = 0.5 * float(np.cbrt(self.scale.volume))
        at = np.array([self.segments[name][0] for name in ("dx", "dy", "dz")])
        for _ in range(40):
            points = self._points(_CHUNK)
            if self.others.count:
                points = points[self._clear(at, points, root)]
            if first_pair(self.segments, self.room, law, root, points, apart):
                self.progress["count"], self.progress["terminals"] = 3, 2
                self.segments["allowed"][:3] = np.inf
                return
            apart *= 0.85
        raise GrowthError(
            "no two branches fit at the end of the root's stem; choose another root_point_mm or "
            "root_direction, fewer terminals, a smaller smallest radius or clearance"
        )

    def _first_guess(self) -> float:
        """Root radius before there is a tree, mm: that of a pipe twice as long as the tissue."""
        if self.scale.root_radius > 0:
            return self.scale.root_radius
        load = 2.0 * self.options.law.k * float(np.cbrt(self.tissue.volume_mm3))
        return float((self.scale.flow_over_drop * load) ** 0.25)

    def _points(self, tries: int) -> Any:
        low, high = self.tissue.bounds
        points = self.random.uniform(low, high, (tries, 3))
        if self.others.owns is not None:
            points = points[self.others.owns(points)]
        in_order = self.terminals > _SMALL
        return inside(self.tissue.grid.arrays, points, low, high, in_order)

    @property
    def _per_inside(self) -> float:
        """Points in the bounds for each in the tissue."""
        return float(np.prod(np.ptp(self.tissue.bounds, axis=0))) / self.scale.volume

    def _clear(self, begin: Any, points: Any, radius: float) -> Any:
        """Whether capsules from ``begin`` to each of ``points`` clear the vessels of others."""
        self._reindex(own=0)
        return clear_of(self.segments, self.index, self.room, begin, points, radius)

    def _reindex(self, own: int | None = None) -> None:
        """List everything anew, in cells that suit the tree until it has doubled.

        Of the tree's own segments ``own`` are listed, or all.
        """
        volume = self.scale.volume
        self.indexed = max(4, self.terminals)
        if self.terminals > _SMALL:
            self.segments = depth_first(self.segments, self.count)
        goal = min(self.options.terminals, 2 * self.terminals)
        cell = _CELL * float(np.cbrt(volume / max(8, goal)))
        room = 16 * len(self.segments) + 4096
        while True:
            self.index = empty_index(self.tissue.bounds, cell, room, len(self.segments))
            end = len(self.segments)
            count = self.count if own is None else own
            listed = list_all(self.segments, count, self.index, self.room)
            listed = listed and list_from(
                self.segments, end - self.others.count, end, self.index, self.room
            )
            if listed and self.index.used[0] < 0.5 * room:
                break
            room *= 2

    def grow(self, until: int | None = None) -> None:
        """Grow up to the goal, wherever growth stands, or to so many terminals on the way."""
        options = self.options
        goal = min(until or options.terminals, options.terminals)
        if self.terminals >= goal:
            return
        self.progress["since"] = 0
        points, first = np.empty((0, 3)), 0
        status = FULL_INDEX
        while status != DONE and self.terminals < goal:
            if status == MORE_POINTS:
                tries = int(np.clip(_TRIES * self._per_inside * self.terminals, _CHUNK, 1 << 21))
                points, first = self._points(tries), 0
            else:
                self._reindex()
                # Neighbours' shares have changed since each segment's room was measured.
                measure_room(self.segments, self.count, self.index, self.room, 0.0)
            status, first = grow(
                self.segments,
                self.index,
                self.room._replace(reserve=self._reserve()),
                options.law,
                self.scale,
                self.progress,
                points,
                first,
                min(2 * self.indexed, goal),
            )
            if self.progress["since"][0] > _PATIENCE:
                raise self._no_room()

    def _reserve(self) -> float:
        """How much wider than predicted trial forks must be able to grow."""
        if self.scale.root_radius > 0:
            return MARGIN
        left = float(np.log(self.options.terminals / self.terminals))
        return min(MARGIN + MARGIN_LEFT * left, MARGIN_AT_MOST)

    def _no_room(self) -> GrowthError:
        smallest = self.options.smallest_radius_mm
        wish = f" of radius {smallest:g} mm or more" if smallest else ""
        asked, root = self.options.terminals, self.scale.root_radius
        reserved = (
            f" beside a trunk from {root:.3g} mm radius, reserved because {asked} terminals need it"
        )
        hint = " (their thinner trunk leaves more room: more than here may then fit)"
        return GrowthError(
            f"only {self.terminals} of {asked} terminals{wish} fit with clearance "
            f"{self.options.clearance_mm:g} mm{reserved if root else ''}: {_PATIENCE} points in a "
            f"row found no place; ask for fewer terminals{hint if root else ''}, a smaller "
            "smallest radius or clearance"
        )

    def audit(self) -> int:
        """Derive the final radii; return how many segments don't fit with them.

        With a smallest radius, a thinner terminal doesn't fit either; nor does a stem too short
        for its radius.
        """
        smallest = self.options.smallest_radius_mm
        root = self.scale.root_radius or self._root_radius()
        thinnest = spread_down(self.segments, self.count, root, 1.0, self.options.law)
        if smallest is not None and thinnest > smallest:
            root *= smallest / thinnest
            spread_down(self.segments, self.count, root, 1.0, self.options.law)
        self._reindex()
        left = measure_room(
            self.segments, self.count, self.index, self.room, _just(smallest or 0.0)
        )
        return int(left) + stem_is_short(self.segments, self.room)

    def _root_radius(self) -> float:
        load = float(self.segments["load"][0])
        return float((self.scale.flow_over_drop * load / self.terminals) ** 0.25)

    def repair(self) -> None:
        """Lengthen the stem, or move tips that are too thin and take away what else doesn't fit."""
        if stem_is_short(self.segments, self.room):
            lengthen_stem(self.segments, self.room, self.options.law)
            return
        if self.options.smallest_radius_mm is not None:
            retip_thin(
                self.segments,
                self.count,
                self.index,
                self.room,
                self.options.law,
                self._points(_CHUNK),
                THIN_MARGIN * self.options.smallest_radius_mm,
            )
        left = prune(self.segments, self.count, self.index, self.room, self.options.law)
        if left == 1:
            raise GrowthError(
                "the branches at the root don't fit with their final radii; choose another "
                "root_point_mm, fewer terminals, a smaller smallest radius or clearance"
            )
        self.progress["count"], self.progress["terminals"] = left, (left + 1) // 2
        self.progress["apart"] = 0.9
        derive_radii(self.segments, self.progress, self.options.law, self.scale)

    def tree(self) -> VesselTree:
        """The finished tree, its ratios computed afresh from geometry and topology."""
        s, smallest = self.segments[: self.count], self.options.smallest_radius_mm
        flow = self.options.flow_ul_s(self.scale.volume)
        drop = flow * float(s["load"][0]) / (self.terminals * float(s["radius"][0]) ** 4)
        tree = tree_from_topology(
            np.column_stack([s["px"], s["py"], s["pz"]]),
            np.column_stack([s["dx"], s["dy"], s["dz"]]),
            s["parent"],
            np.column_stack([s["left"], s["right"]]),
            flow_ul_s=flow,
            pressure_drop_pa=drop if smallest else self.options.pressure_drop_pa,
            murray_exponent=self.options.murray_exponent,
            viscosity_pa_s=self.options.viscosity_pa_s,
        )
        return scaled_to_smallest_radius(tree, smallest) if smallest else tree
